"""The program a controller plays: segments of references, and the guards that end them."""

from typing import Literal

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.laws.parameters import LawSpec
from pincette.control.planning.paths import Path
from pincette.control.planning.repetition import Corrections
from pincette.control.planning.sweep import Sweep
from pincette.control.quantities import (
    Hertz,
    Items,
    Micrometre,
    Millinewton,
    MillinewtonPerMicrometre,
    Number,
    Second,
    Text,
    Volt,
    Whole,
)
from pincette.control.record import FrozenRecord
from pincette.control.voltage_range import VoltageRange

RETREATS = ("unload", "retreat")
"""Phases of the way back."""
SegmentKind = Literal["zero", "free", "seek", "force", "path", "voltage", "sweep"]
Sides = Literal["both", "first", "second"]


class BothArms(FrozenRecord, frozen=True):
    """Goals of two driven arms in one segment, beside what ``Segment`` says of the force.

    Both count towards the part: its place is q = (x_1 - x_2)/2, and the arms have closed by
    x_1 + x_2. Free arms are led to tips, arms that hold a part along place and force.

    ``free``    the tips move to ``first_to_um`` and ``second_to_um``.
    ``seek``    the tips move there at constant speed, until each of ``sides`` has touched.
    ``force``   the place moves to ``place_to_um`` while the force moves to ``force_to_mN``.
    ``path``    the place follows ``place_path`` while the force follows ``path``; what has no path
                rests.
    ``voltage`` the second voltage follows ``second_voltages_V`` or ``second_path``, or moves to
                ``second_to_V``.

    What is None stays where it is.
    """

    first_to_um: Micrometre | None = None
    second_to_um: Micrometre | None = None
    relative: bool = False
    """Tips count from where each arm has touched the part, a place from where the part was when it
    was held first, or when a program began that has found it held."""
    sides: Sides = "both"
    place_to_um: Micrometre | None = None
    place_path: Path | None = None
    second_to_V: Volt | None = None
    second_path: Path | None = None
    second_voltages_V: Items[Volt] = ()


class Segment(FrozenRecord, frozen=True):
    """One piece of a program.

    ``zero``   the arm rests, free of contact; at its end the force estimator is re-zeroed.
    ``free``   x_r moves smoothly to ``x_to_um``; the law gets no force.
    ``seek``   x_r moves at constant speed to ``x_to_um`` until the contact guard fires; it comes to
               that speed in ``move_s``, or without it at once.
    ``force``  F_r moves smoothly to ``force_to_mN`` and x_r with it, on the contact line
               F_r = K_e·(x_r - x_e), in ``move_s``; then both rest until ``duration_s``.
    ``path``   of force: F_r follows ``path`` and x_r with it, on the contact line; of position:
               x_r follows it, free of contact. It begins where the segment before has ended.
    ``voltage`` no law: the voltage follows ``voltages_V`` or ``path``, or moves smoothly from where
               it is to ``voltage_to_V``, or without any stays as it is.
    ``sweep``  no law: the output plays ``sweep`` about the voltage at which the segment begins.
    """

    phase: Text
    kind: SegmentKind
    duration_s: Second | None
    """None: until an action ends it; of a voltage, ``continue``, or with a part ``release``."""
    x_to_um: Micrometre | None = None
    force_to_mN: Millinewton | None = None
    move_s: Second | None = None
    """None: the whole duration."""
    path: Path | None = None
    sweep: Sweep | None = None
    law: Whole = 0
    """Which of the program's laws holds."""
    voltage_to_V: Volt | None = None
    voltages_V: Items[Volt] = ()
    """Of a voltage: one for each tick; the last of them stays."""
    zeroes: bool = False
    """Of a voltage: at its end the force estimator is re-zeroed."""
    guarded: bool = False
    """Free of contact: what the arm meets ends the program as ``contact``."""
    follows: bool = False
    """Of a force, after a seek: it begins with the speed of the seek, and x_r follows the contact
    line as it is identified meanwhile."""
    both: BothArms | None = None
    """Of a rig of two arms, for which the kinds mean what ``BothArms`` says."""

    @property
    def stamps_zero(self) -> bool:
        """Whether at its end the force estimator is re-zeroed."""
        return self.kind == "zero" or self.zeroes

    @property
    def presses(self) -> bool:
        """Whether the force is an input of the law."""
        if self.kind == "path":
            return self.both is not None or (
                self.path is not None and self.path.quantity == "force"
            )
        return self.kind == "force"

    @property
    def open_loop(self) -> bool:
        """Whether no law holds."""
        return self.kind in ("voltage", "sweep")


class Guards(FrozenRecord, frozen=True):
    """What ends a segment early. Forces compressive and positive, in mN."""

    contact_force_mN: Millinewton
    """Estimated force above which contact is believed."""
    contact_samples: Whole
    """Consecutive samples above it."""
    force_max_mN: Millinewton
    """Estimated force that ends the grip as ``overforce``."""
    lost_fraction: Number
    """Share of F_r below which, in the hold, the part counts as lost; along a path only where F_r
    is at least twice the contact force."""
    lost_samples: Whole
    stiffness_min_mN_per_um: MillinewtonPerMicrometre
    stiffness_max_mN_per_um: MillinewtonPerMicrometre
    zero_wait_s: Second
    """How long the controller waits for the estimator to confirm a zero."""
    position_min_um: Micrometre | None = None
    position_max_um: Micrometre | None = None
    """Measured position beyond which motion without a law ends as ``overtravel``; None: none."""
    zero_needed: bool = True
    """Whether a zero that is refused ends the program; else it goes on without one."""


class PlannedRange(FrozenRecord, frozen=True):
    """References and voltages that a plan has stated, for every part that it admits.

    The controller keeps the references of a pressed part within it; the actuator keeps the voltage
    within it from the arming on.
    """

    voltage: VoltageRange
    second_voltage: VoltageRange | None = None
    """Voltages of the second arm; None: there is one arm, or its range is not stated."""
    position_min_um: Micrometre | None = None
    """Lowest position reference of a pressed part; None: none is stated."""
    position_max_um: Micrometre | None = None
    """Highest position reference of a pressed part; None: none is stated."""
    force_max_mN: Millinewton | None = None
    """Highest force reference; None: none is stated."""


class Program(FrozenRecord, frozen=True):
    """Segments in order, guards, the contact stiffness K_e the plan assumes, and the laws.

    Raises
    ------
    ValueError
        Where it cannot be played: K_e or a duration is impossible, a segment has nothing to
        follow, or a search has nowhere to go on to.
    """

    segments: Items[Segment]
    guards: Guards
    contact_stiffness_mN_per_um: MillinewtonPerMicrometre
    laws: Items[LawSpec] = ()
    """None: the rig file's."""
    contact_line: Literal["identified", "planned"] = "identified"
    """K_e and x_e as the load shows them, or K_e as planned and x_e from the first touch."""
    capture_hz: Hertz = 0.0
    """Rate at which the sensor acquires beside the samples of the loop; 0: not."""
    begins_held: bool = False
    """Whether a part is in the gripper when it begins."""
    corrections: Corrections | None = None
    """What is learned along the cycles of its path, to begin with; None: nothing is learned."""
    planned_range: PlannedRange | None = None
    """Range that no reference and no voltage may leave; None: the rig's limits."""
    slip_retries: Whole = 0
    """Number of slips after which a load goes on from where the part has stopped."""

    def __post_init__(self) -> None:
        require_positive("contact stiffness K_e", self.contact_stiffness_mN_per_um, "mN/µm")
        for place, segment in enumerate(self.segments):
            name = f"segment {place} ({segment.phase})"
            for quantity in ("duration_s", "move_s"):
                value_s = getattr(segment, quantity)
                if value_s is not None:
                    require_not_negative(f"{name}: {quantity}", value_s, "s")
            for kind in ("path", "sweep"):
                placed = segment.both is not None and segment.both.place_path is not None
                if segment.kind == kind and getattr(segment, kind) is None and not placed:
                    raise ValueError(f"{name} is a {kind} and has none")
            if segment.voltages_V and segment.kind != "voltage":
                raise ValueError(f"{name} has voltages and is a {segment.kind}")
            if segment.kind == "seek":
                _check_search(name, segment, last=place + 1 == len(self.segments))


def _check_search(name: str, segment: Segment, *, last: bool) -> None:
    """A search goes on to the next segment where it finds the part, else to the retreat."""
    if last:
        raise ValueError(f"{name} seeks a part, and nothing follows")
    if segment.phase in RETREATS:
        raise ValueError(f"{name} seeks a part, and is the way back from one")
