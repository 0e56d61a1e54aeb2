"""Motion program of a controller: segments of references, and guards that end them."""

from typing import Literal

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.laws.parameters import LawSpec
from pincette.control.planning.repetition import Corrections
from pincette.control.planning.segments import Press, Seek, Segment
from pincette.control.quantities import (
    Arms,
    Hertz,
    Items,
    Micrometre,
    Millinewton,
    MillinewtonPerMicrometre,
    Number,
    Second,
    Whole,
)
from pincette.control.record import FrozenRecord
from pincette.control.voltage_range import VoltageRange

RETREATS = ("unload", "retreat")
"""Names of the phases in which the arm returns."""


class Guards(FrozenRecord, frozen=True):
    """Conditions that end a segment early; compressive forces are positive, in mN."""

    contact_force_mN: Millinewton
    """Estimated force above which a contact is detected, in mN."""
    contact_samples: Whole
    """Number of consecutive samples above the contact force."""
    force_max_mN: Millinewton
    """Estimated force at which the program ends with ``overforce``, in mN."""
    lost_fraction: Number
    """Fraction of F_r below which a held part counts as lost; along a path only while F_r is at
    least twice the contact force."""
    lost_samples: Whole
    stiffness_min_mN_per_um: MillinewtonPerMicrometre
    stiffness_max_mN_per_um: MillinewtonPerMicrometre
    zero_wait_s: Second
    """Longest time for which the controller waits for the estimator to confirm a zero, in s."""
    position_min_um: Micrometre | None = None
    position_max_um: Micrometre | None = None
    """Upper limit of the measured position, in µm; beyond it a motion without a law ends with
    ``overtravel``; None: no limit."""
    zero_needed: bool = True
    """True if a refused zero ends the program; False if the program continues without a zero."""
    contacts_from_um: Items[Micrometre] = ()
    """Smallest contact position that the plan permits for each arm, in µm. If a search finds the
    part before this position, and the zero of the force is not confirmed, the arm returns. Empty:
    any position is permitted."""
    bend_mN_per_um: MillinewtonPerMicrometre = 0.0
    """Stiffness, in mN/µm, below which an apparent contact beyond the start position of the program
    is attributed to a bend in the response of the free arm itself. This applies up to ten times the
    contact force. 0: every kink counts as a contact."""


class PlannedRange(FrozenRecord, frozen=True):
    """Range of references and voltages that a plan needs, for every part that it permits.

    The controller keeps the references of a pressed part within the range. The actuator keeps the
    voltage within it from the arming on.
    """

    voltages: Arms[VoltageRange]
    """Voltage range of each arm, the first arm first; an arm that is not listed has no planned
    range."""
    position_min_um: Micrometre | None = None
    """Lowest position reference of a pressed part, in µm; None: no limit."""
    position_max_um: Micrometre | None = None
    """Highest position reference of a pressed part, in µm; None: no limit."""
    force_max_mN: Millinewton | None = None
    """Highest force reference, in mN; None: no limit."""


class Program(FrozenRecord, frozen=True):
    """Segments in order, guards, the planned contact stiffness K_e, and the laws.

    Raises
    ------
    ValueError
        If the program cannot be played: K_e or a duration is impossible, or no segment follows a
        search.
    """

    segments: Items[Segment]
    guards: Guards
    contact_stiffness_mN_per_um: MillinewtonPerMicrometre
    laws: Items[LawSpec] = ()
    """Laws of the program; None: that of the rig file."""
    contact_line: Literal["identified", "planned"] = "identified"
    """Source of K_e and x_e: identified during the load, or K_e as planned and x_e from the first
    contact."""
    capture_hz: Hertz = 0.0
    """Rate of acquisition in addition to the loop's samples, in Hz; 0 for no capture."""
    begins_held: bool = False
    """True if a part is held when the program begins."""
    corrections: Corrections | None = None
    """Initial corrections for the cycles of the program's path; None: no learning."""
    planned_range: PlannedRange | None = None
    """Range that references and voltages must not leave; None: the rig's limits."""
    slip_retries: Whole = 0
    """Number of slips after which a load continues from the new position of the part."""

    @property
    def takes_force_over(self) -> bool:
        """Return whether the program begins by loading or unloading a held part to a force."""
        first = self.segments[0] if self.segments else None
        return self.begins_held and isinstance(first, Press) and first.to_mN is not None

    def __post_init__(self) -> None:
        require_positive("contact stiffness K_e", self.contact_stiffness_mN_per_um, "mN/µm")
        for place, segment in enumerate(self.segments):
            name = f"segment {place} ({segment.phase})"
            for quantity in ("duration_s", "move_s", "run_up_s"):
                value_s = getattr(segment, quantity, None)
                if value_s is not None:
                    require_not_negative(f"{name}: {quantity}", value_s, "s")
            if isinstance(segment, Seek):
                _check_search(name, segment, last=place + 1 == len(self.segments))


def _check_search(name: str, segment: Seek, *, last: bool) -> None:
    """Raise ValueError if a search is the last segment or belongs to a retreat."""
    if last:
        raise ValueError(f"{name} seeks a part, but nothing follows it")
    if segment.phase in RETREATS:
        raise ValueError(f"{name} seeks a part, but is a retreat from one")
