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
"""Number of commands of another sender that are taken for a second controller instead of leftovers.
"""


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Every limit and time of the actuator."""

    period_s: float
    lockstep: bool
    """True if time passes only with ticks, which do not come while nothing is armed."""
    age: AgeLimits
    arms: tuple[ArmLimits, ...]
    """Limits of each arm, one or two."""
    ramp_s: float
    freeze_s: float
    """Time for which a held part is kept after a trip, before the ramp releases it, in s."""
    safe_V: float
    shaping_s: float | None = None
    """Time between two of the three parts of a step, in s; None for steps in one part. Only rigs of
    one arm write steps in parts."""

    @property
    def parts_s(self) -> float:
        """Return the time from the first to the last part of a step, in s; 0 for a single part."""
        return 0.0 if self.shaping_s is None else LAST * self.shaping_s


class UnauthorizedCommands(FrozenRecord, frozen=True):
    """Commands without authority in this arming, and the fault of the newest one."""

    count: int = 0
    newest: Fault | None = None

    def alarm(self) -> tuple[Fault, ...]:
        """Return an alarm for the operator; empty for one or two possibly leftover messages."""
        if self.count < ALARM or self.newest is None:
            return ()
        return fault(FaultCode.SECOND_CONTROLLER, commands=self.count), self.newest


NO_UNAUTHORIZED = UnauthorizedCommands()


class SafetyState(FrozenRecord, frozen=True):
    """Authority, latch, voltage of each arm, and observations of the rules."""

    mode: Mode = Mode.LATCHED
    cause: Cause = Cause.BOOT
    faults: tuple[Fault, ...] = ()
    """Faults that explain the cause: the detected limits, why the preceding commands were not
    valid, why a freeze ended early."""
    epoch: int = 0
    owner: int = 0
    arms: tuple[ArmOutput, ...] = (ArmOutput(),)
    """State of each arm's output, as many as there are limits; everything else is common to all
    arms."""
    part_held: bool = False
    """True if a part is held according to the last good command; it determines the reaction to a
    fault."""
    moved_s: float = -inf
    """Time of the last change of a voltage, in s."""
    slewing_s: float | None = None
    """Time since then for which the newest command could slew, in s; None in lockstep, which has no
    clock."""
    taken_seq: int = -1
    fresh_s: float = 0.0
    """Arrival of the sample on which the last good command was based, in s."""
    arrivals: Arrivals = ()
    since_s: float = 0.0
    """Time of the start of the freeze or the ramp, in s."""
    blind: Fault | None = None
    """Why the newest command is not valid; None if it is valid, or does not say."""
    ran_s: float | None = None
    """Time at which the actuator last ran, in s; None before its first run."""
    excused_s: float = 0.0
    """Standstill excluded since the last good command, in s."""
    standstills: int = 0
    refused: int = 0
    refusal: Fault | None = None
    """Reason of the newest refusal of a command."""
    unauthorized: UnauthorizedCommands = NO_UNAUTHORIZED
    predecessor: Predecessor = Predecessor.NONE
    """How the previous actuator program ended."""
    unconfirmed: bool = False
    """True if the output has not confirmed its last command."""
    located: bool = False
    """True if the output has reported its voltage since it failed."""
    asked_s: float = -inf
    """Time of the last request for the output's voltage, in s."""
    shaped: ShapedStep | None = None
    """Newest step that was written in parts; the voltage of the arm is its end."""
    interrupted: bool = False
    """True after a step was broken off between two parts, until its voltage is written."""

    @property
    def findings(self) -> tuple[Fault, ...]:
        """Return the faults to report besides the cause: alarm, refusal, standstills."""
        found = self.unauthorized.alarm()
        if self.refusal is not None and self.refusal not in found:
            found = (*found, self.refusal)
        stood = self.standstills
        return (*found, fault(FaultCode.STANDSTILLS, times=stood)) if stood else found
