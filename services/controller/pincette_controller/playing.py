"""Where a program stands."""

from dataclasses import dataclass, field
from typing import NamedTuple

from pincette.control.planning.contact_line import ContactLine
from pincette.control.planning.program import Segment
from pincette.control.replacing import replace


class References(NamedTuple):
    """What the law shall follow in one sample, or the voltage where there is none."""

    x_r_um: float
    speed_um_per_s: float
    force_r_mN: float
    voltage_V: float


@dataclass(frozen=True, slots=True)
class Player:
    """Where a program stands, and the references of the coming sample."""

    index: int
    segment: Segment
    ticks: int
    x_r_um: float
    speed_um_per_s: float
    force_r_mN: float
    from_x_um: float
    from_speed_um_per_s: float
    from_force_mN: float
    contact_x_um: float | None = None
    K_e_mN_per_um: float | None = None
    line: ContactLine = field(default_factory=ContactLine)
    count: int = 0
    """Consecutive samples that a guard has seen."""
    zeroing: bool = False
    """The estimator has been asked for a zero and has not answered."""
    zero: bool = False
    """The command of this tick carries the zero."""
    held: bool = False
    outcome: str = ""
    ended: bool = False
    bump: bool = False
    """The law must be rebased before this tick: the force it is fed begins or ends."""
    applied_V: float = 0.0
    """As the newest estimate has it."""
    from_V: float = 0.0
    """The voltage at which the segment began."""
    voltage_V: float = 0.0
    """What an open-loop segment asks for."""
    pausing: bool = False
    """A pause is wished for, and begins at the next safe point."""
    paused: bool = False
    """The references rest, and the segment's time stands still."""
    resumed: bool = False
    """The pause has just ended: the newest sample is one of the rest."""
    ends_after: str = ""
    """Phase under a law with which the program ends early; empty: none."""

    @property
    def pressing(self) -> bool:
        """Whether the law is fed the force."""
        return self.segment.presses

    @property
    def references(self) -> References:
        """Those that hold."""
        return References(self.x_r_um, self.speed_um_per_s, self.force_r_mN, self.voltage_V)

    def at(self, ticks: int, references: References) -> "Player":
        """At another tick of the segment, with the references of that."""
        return replace(
            self,
            ticks=ticks,
            x_r_um=references.x_r_um,
            speed_um_per_s=references.speed_um_per_s,
            force_r_mN=references.force_r_mN,
            voltage_V=references.voltage_V,
        )
