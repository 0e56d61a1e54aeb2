"""What the rules go by, and what they remember from one event to the next."""

from dataclasses import dataclass

from pincette.control.safety.causes import Cause, Mode
from pincette.control.safety.freshness import AgeLimits, Arrivals
from pincette.control.safety.monitors import UNSEEN, MonitorLimits, Watches
from pincette.control.safety.voltage import VoltageLimits

ALARM = 3
"""Commands of a stranger from which on it is no remnant but a second controller."""


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Every limit and time of the actuator."""

    period_s: float
    lockstep: bool
    """Time passes with the ticks alone, and none comes while nothing is armed."""
    age: AgeLimits
    voltage: VoltageLimits
    monitors: MonitorLimits
    ramp_s: float
    freeze_s: float
    """How long a held part is kept after a trip, before the ramp releases it."""
    safe_V: float


@dataclass(frozen=True, slots=True)
class Strangers:
    """Commands that came without authority in this arming, and whose the newest was."""

    count: int = 0
    words: str = ""

    def alarm(self) -> str:
        """What an operator must see; empty where a message or two may have been left over."""
        if self.count < ALARM:
            return ""
        return f"alarm: {self.count} commands of a stranger refused, the last a {self.words}"


NO_STRANGERS = Strangers()


@dataclass(frozen=True, slots=True)
class SafetyState:
    """Authority, latch, voltage, and what the rules have seen."""

    mode: Mode = "latched"
    cause: str = Cause.BOOT.value
    epoch: int = 0
    owner: int = 0
    voltage_V: float = 0.0
    part_held: bool = False
    """By the last good command: what a fault means was decided before the fault."""
    taken_seq: int = -1
    fresh_s: float = 0.0
    """Arrival of the sample on which the last good command was based."""
    arrivals: Arrivals = ()
    since_s: float = 0.0
    """Begin of the freeze or the ramp."""
    ramp_from_V: float = 0.0
    limits_active: int = 0
    blind: str = ""
    """Why the newest command is not valid; empty where it is."""
    watches: Watches = UNSEEN
    ran_s: float | None = None
    """When the actuator ran last."""
    excused_s: float = 0.0
    """Standstill left out since the last good command."""
    standstills: int = 0
    refused: int = 0
    refusal: str = ""
    """Why a command was refused last."""
    strangers: Strangers = NO_STRANGERS
    unconfirmed: bool = False
    """The output has not confirmed what it was told last."""

    @property
    def detail(self) -> str:
        """What a person asks for first: mode, cause, alarm, last refusal, standstills."""
        stood = f"stood still {self.standstills} times" if self.standstills else ""
        texts = (self.mode, self.cause, self.strangers.alarm(), self.refusal, stood)
        return "; ".join(text for text in texts if text)
