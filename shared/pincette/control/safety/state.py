"""Limits that the rules use, and the state that they keep between events."""

from dataclasses import dataclass
from math import inf

from pincette.control.arm.shaping import LAST, ShapedStep
from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.record import FrozenRecord
from pincette.control.safety.arm import ArmLimits, ArmOutput
from pincette.control.safety.causes import Cause, Mode, Predecessor
from pincette.control.safety.freshness import AgeLimits, Arrivals

ALARM = 3
"""Commands of a stranger from which on it is no remnant but a second controller."""


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Every limit and time of the actuator."""

    period_s: float
    lockstep: bool
    """Whether time passes only with ticks, none of which comes while nothing is armed."""
    age: AgeLimits
    arms: tuple[ArmLimits, ...]
    """One or two."""
    ramp_s: float
    freeze_s: float
    """Time for which a held part is kept after a trip, before the ramp releases it."""
    safe_V: float
    shaping_s: float | None = None
    """Time between two of the three parts in which a step is written; None: it has one part. Only
    rigs of one arm write steps in parts."""

    @property
    def parts_s(self) -> float:
        """Return the time from the first to the last part of a step; 0 if it is written at once."""
        return 0.0 if self.shaping_s is None else LAST * self.shaping_s


class Strangers(FrozenRecord, frozen=True):
    """Commands without authority in this arming, and the owner of the newest one."""

    count: int = 0
    newest: Fault | None = None

    def alarm(self) -> tuple[Fault, ...]:
        """Return an alarm for the operator; none if a message or two may have been left over."""
        if self.count < ALARM or self.newest is None:
            return ()
        return fault(FaultCode.SECOND_CONTROLLER, commands=self.count), self.newest


NO_STRANGERS = Strangers()


class SafetyState(FrozenRecord, frozen=True):
    """Authority, latch, voltage of each arm, and what the rules have seen."""

    mode: Mode = Mode.LATCHED
    cause: Cause = Cause.BOOT
    faults: tuple[Fault, ...] = ()
    """Behind the cause: what was found, why the commands before were not valid, why a freeze has
    ended early."""
    epoch: int = 0
    owner: int = 0
    arms: tuple[ArmOutput, ...] = (ArmOutput(),)
    """Outputs, as many as the limits have; everything else is common to all arms."""
    part_held: bool = False
    """Whether a part is held by the last good command: it decided beforehand what a fault means."""
    moved_s: float = -inf
    """Time of the last change of a voltage."""
    slewing_s: float | None = None
    """What the newest command had of the time since then; None in lockstep, which has no clock."""
    taken_seq: int = -1
    fresh_s: float = 0.0
    """Arrival of the sample on which the last good command was based."""
    arrivals: Arrivals = ()
    since_s: float = 0.0
    """Begin of the freeze or the ramp."""
    blind: Fault | None = None
    """Why the newest command is not valid; None where it is, or does not say."""
    ran_s: float | None = None
    """When the actuator ran last."""
    excused_s: float = 0.0
    """Standstill left out since the last good command."""
    standstills: int = 0
    refused: int = 0
    refusal: Fault | None = None
    """Why a command was refused last."""
    strangers: Strangers = NO_STRANGERS
    predecessor: Predecessor = Predecessor.NONE
    """How the previous actuator program has ended."""
    unconfirmed: bool = False
    """Whether the output has not confirmed its last command."""
    located: bool = False
    """Since it has failed it has said what it puts out."""
    asked_s: float = -inf
    """Time at which it was last asked for its voltage."""
    shaped: ShapedStep | None = None
    """Newest step that was written in parts; the voltage of the arm is its end."""
    interrupted: bool = False
    """True after a step was broken off between two parts, until its voltage is written."""

    @property
    def findings(self) -> tuple[Fault, ...]:
        """Return what a person asks for first, besides the cause: alarm, refusal, standstills."""
        found = self.strangers.alarm()
        if self.refusal is not None and self.refusal not in found:
            found = (*found, self.refusal)
        stood = self.standstills
        return (*found, fault(FaultCode.STANDSTILLS, times=stood)) if stood else found
