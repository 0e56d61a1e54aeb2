"""Limits of the safety rules, and the state that they keep between events."""

from dataclasses import dataclass
from math import inf

from pincette.control.arm.shaping import LAST, ShapedStep
from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.record import FrozenRecord
from pincette.control.safety.arm import ArmLimits, ArmOutput
from pincette.control.safety.causes import Cause, Mode, Predecessor
from pincette.control.safety.freshness import AgeLimits, Arrivals

ALARM = 3
"""Number of commands from another sender that indicate a second controller rather than leftover
messages."""


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """All limits and times of the actuator."""

    period_s: float
    lockstep: bool
    """True if time passes only with ticks, and no ticks come while nothing is armed."""
    age: AgeLimits
    arms: tuple[ArmLimits, ...]
    """Limits of each arm, one or two."""
    ramp_s: float
    freeze_s: float
    """Time for which a held part is kept after a trip, in s. Then the ramp releases it."""
    safe_V: float
    shaping_s: float | None = None
    """Time between two of the three parts of a step, in s; None for steps in one part. Only rigs
    with one arm write steps in parts."""

    @property
    def parts_s(self) -> float:
        """Return the time from the first to the last part of a step, in s; 0 for a single part."""
        return 0.0 if self.shaping_s is None else LAST * self.shaping_s


class UnauthorizedCommands(FrozenRecord, frozen=True):
    """Commands without authority during this arming, and the fault of the newest one."""

    count: int = 0
    newest: Fault | None = None

    def alarm(self) -> tuple[Fault, ...]:
        """Return an alarm for the operator; empty for one or two possible leftover messages."""
        if self.count < ALARM or self.newest is None:
            return ()
        return fault(FaultCode.SECOND_CONTROLLER, commands=self.count), self.newest


NO_UNAUTHORIZED = UnauthorizedCommands()


class SafetyState(FrozenRecord, frozen=True):
    """Authority, latch, voltage of each arm, and observations of the rules."""

    mode: Mode = Mode.LATCHED
    cause: Cause = Cause.BOOT
    faults: tuple[Fault, ...] = ()
    """Faults that explain the cause: the exceeded limits, the reasons why the preceding commands
    were not valid, the reason for an early end of a freeze."""
    epoch: int = 0
    owner: int = 0
    arms: tuple[ArmOutput, ...] = (ArmOutput(),)
    """State of each arm's output, as many as there are limits. All other fields are common to all
    arms."""
    part_held: bool = False
    """True if a part is held according to the last accepted command; determines the reaction to a
    fault."""
    moved_s: float = -inf
    """Time of the last change of a voltage, in s."""
    slewing_s: float | None = None
    """Time for which the newest command was allowed to slew, in s; None in lockstep, which has no
    clock."""
    taken_seq: int = -1
    fresh_s: float = 0.0
    """Arrival time of the sample on which the last accepted command was based, in s."""
    arrivals: Arrivals = ()
    since_s: float = 0.0
    """Time at which the freeze or the ramp began, in s."""
    blind: Fault | None = None
    """Reason why the newest command is not valid; None if it is valid or states no reason."""
    ran_s: float | None = None
    """Time at which the actuator last ran, in s; None before its first run."""
    excused_s: float = 0.0
    """Total time of stalls that was subtracted from ages since the last accepted command, in s."""
    standstills: int = 0
    refused: int = 0
    refusal: Fault | None = None
    """Reason for the newest refusal of a command."""
    unauthorized: UnauthorizedCommands = NO_UNAUTHORIZED
    predecessor: Predecessor = Predecessor.NONE
    """The way the previous actuator program ended."""
    unconfirmed: bool = False
    """True if the output has not confirmed its last command."""
    located: bool = False
    """True if the output has reported its voltage since it failed."""
    asked_s: float = -inf
    """Time of the last request to the output for its voltage, in s."""
    shaped: ShapedStep | None = None
    """Newest step that was written in parts; the voltage of the arm is its final value."""
    interrupted: bool = False
    """True after a step was interrupted between two parts, until its voltage is written."""

    @property
    def findings(self) -> tuple[Fault, ...]:
        """Return the faults to report in addition to the cause: alarm, refusal, stalls."""
        found = self.unauthorized.alarm()
        if self.refusal is not None and self.refusal not in found:
            found = (*found, self.refusal)
        stood = self.standstills
        return (*found, fault(FaultCode.STANDSTILLS, times=stood)) if stood else found
