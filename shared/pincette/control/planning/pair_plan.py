"""Motions of two arms that meet a part (grip, track, centre) or move a held one.

Both arms close symmetrically about the position of the part, from their stand-off positions, where
both forces are zeroed. ``centre`` first searches for the part with one arm after the other, and
closes about the position that the two contacts give.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.laws.two_arms import Pair
from pincette.control.planning.contact_plan import LOST_FRACTION, LOST_SAMPLES, ZERO_WAIT_S
from pincette.control.planning.contact_request import CONTACT_SAMPLES, MARGIN_UM
from pincette.control.planning.paths import Path
from pincette.control.planning.profiles import SHORTEST_MOVE_S, move_duration
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import (
    Drive,
    Move,
    Press,
    Ramp,
    Rest,
    Seek,
    Segment,
    Track,
)

BACK_UM = 3.0
"""Distance by which an arm moves back after it has found the part, in µm."""
SETTLE_S = 0.8
"""Time between the end of the load and the start of a path, in s."""
CARRIED = "rest"
"""Last phase of a program that moves a held part and ends while the part is still held."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairRequest:
    """Request in which both arms meet, load and leave a part.

    Raises
    ------
    ValueError
        If a number is impossible.
    """

    force_mN: float
    load_s: float
    approach_um_per_s: float
    """Peak speed of each arm, in µm/s."""
    seek_um_per_s: float
    """Speed of the sum of both positions while the arms close on the part, in µm/s. An arm that
    searches alone moves at half this speed, so that the contact speed of an arm is the same in both
    cases."""
    contact_force_mN: float
    """Force of each arm at which its contact is detected, in mN."""
    zero_s: float
    contacts_um: Pair
    """Tip positions of both arms at first contact, in µm, for the expected position of the part."""
    contact_tolerance_um: float
    stiffness_mN_per_um: float
    """Stiffness 1/c of part and faces together, in mN/µm."""
    centred: bool = False
    """True if each arm first searches for the part from its own side."""
    compliances_um_per_mN: Pair = (0.0, 0.0)
    """Compliances s_i of the arms, in µm/mN: a contact force F moves the tip back from its free
    position by s_i·F."""

    def __post_init__(self) -> None:
        for name in (
            "force_mN",
            "load_s",
            "approach_um_per_s",
            "seek_um_per_s",
            "contact_force_mN",
            "zero_s",
            "stiffness_mN_per_um",
        ):
            require_positive(name, getattr(self, name), "")
        require_not_negative("contact_tolerance_um", self.contact_tolerance_um, "µm")

    @property
    def stand_offs_um(self) -> Pair:
        """Return the positions of both arms for the zero, where they cannot touch the part."""
        back_um = self.contact_tolerance_um + MARGIN_UM
        return self.contacts_um[0] - back_um, self.contacts_um[1] - back_um

    @property
    def furthest_um(self) -> Pair:
        """Return the furthest position to which each arm moves in search of the part, in µm."""
        on_um = self.contact_tolerance_um + MARGIN_UM
        on_um += self.contact_force_mN / self.stiffness_mN_per_um
        first, second = (s * self.contact_force_mN + on_um for s in self.compliances_um_per_mN)
        return self.contacts_um[0] + first, self.contacts_um[1] + second

    @property
    def place_um(self) -> float:
        """Return the expected position q of the part."""
        return 0.5 * (self.contacts_um[0] - self.contacts_um[1])


@dataclass(frozen=True, slots=True, kw_only=True)
class PairHold:
    """A force to hold, and the position at which the part is held."""

    hold_s: float | None
    """Duration of the hold, in s; None: the hold lasts until an action ends it."""
    place_to_um: float | None = None
    """Position to which the part is moved first, in µm; None: the part stays where the arms met
    it."""
    carry_um_per_s: float = 20.0
    """Peak speed of the motion of the part to ``place_to_um``, in µm/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairPaths:
    """Paths of force and position; a quantity without a path stays constant."""

    force: Path | None
    place: Path | None

    def __post_init__(self) -> None:
        if self.force is None and self.place is None:
            raise ValueError("a track needs a path of force or of place")
        for path, quantity in ((self.force, "force"), (self.place, "position")):
            if path is not None and path.quantity != quantity:
                raise ValueError(f"a path of {path.quantity} instead of one of {quantity}")

    @property
    def duration_s(self) -> float:
        """Return the duration of the longer path; after the end of a path its value stays
        constant.
        """
        return max(path.duration_s for path in (self.force, self.place) if path is not None)


def grip_program(
    request: PairRequest,
    hold: PairHold,
    starts_um: Pair,
    most_mN: float,
    homes_um: Pair | None = None,
) -> Program:
    """Return a program that grips a part, moves it, holds it and releases it.

    Parameters
    ----------
    starts_um
        Positions at which both arms rest.
    most_mN
        Force of either arm at which the program ends.
    homes_um
        Positions to which both arms return; None: ``starts_um``.
    """
    force_mN = request.force_mN
    settle_s = SHORTEST_MOVE_S if hold.hold_s is None else min(SHORTEST_MOVE_S, hold.hold_s)
    pressing: list[Segment] = [Press("load", request.load_s, to_mN=force_mN)]
    if hold.place_to_um is not None:
        way_um = hold.place_to_um - request.place_um
        carry_s = move_duration(way_um, hold.carry_um_per_s)
        pressing.append(Press("carry", carry_s, to_mN=force_mN, place_um=hold.place_to_um))
    pressing.append(Press("hold", hold.hold_s, to_mN=force_mN, move_s=settle_s))
    return _program(request, pressing, starts_um, most_mN, homes_um or starts_um)


def track_program(
    request: PairRequest,
    paths: PairPaths,
    starts_um: Pair,
    most_mN: float,
    homes_um: Pair | None = None,
) -> Program:
    """Return a program that grips a part, follows paths of force and position, and releases it."""
    force, place = paths.force, paths.place
    begin_mN = request.force_mN if force is None else force.start
    begin_um = request.place_um if place is None else place.start
    settle_s = max(SETTLE_S, move_duration(begin_um - request.place_um, request.approach_um_per_s))
    pressing = [
        Press("load", request.load_s, to_mN=begin_mN),
        Press(
            "settle",
            settle_s + SETTLE_S,
            to_mN=begin_mN,
            move_s=settle_s,
            place_um=None if place is None else begin_um,
        ),
        Track("track", paths.duration_s, force=force, place=place),
    ]
    return _program(request, pressing, starts_um, most_mN, homes_um or starts_um)


def carry_program(
    by_um: float, speed_um_per_s: float, guards: Guards, *, release_s: float, safe_V: float
) -> Program:
    """Return a program that moves a held part at its present force, and keeps it held.

    The force need not be known: no zero is possible, and the references of the force stay
    unchanged. The final unload is played only if an action or a guard releases the part.
    """
    segments = (
        Press("move", move_duration(by_um, speed_um_per_s), place_um=by_um, relative=True),
        Press(CARRIED, SETTLE_S),
        Drive("unload", release_s, courses=(Ramp(safe_V), Ramp(safe_V))),
    )
    return Program(segments, guards, contact_stiffness_mN_per_um=1.0, begins_held=True)


def pair_guards(request: PairRequest, most_mN: float) -> Guards:
    """Return the guards of a motion of both arms."""
    return Guards(
        contact_force_mN=request.contact_force_mN,
        contact_samples=CONTACT_SAMPLES,
        force_max_mN=most_mN,
        lost_fraction=LOST_FRACTION,
        lost_samples=LOST_SAMPLES,
        stiffness_min_mN_per_um=0.0,
        stiffness_max_mN_per_um=request.stiffness_mN_per_um,
        zero_wait_s=ZERO_WAIT_S,
        contacts_from_um=tuple(
            contact_um - request.contact_tolerance_um for contact_um in request.contacts_um
        ),
    )


def _program(
    request: PairRequest,
    pressing: Sequence[Segment],
    starts_um: Pair,
    most_mN: float,
    homes_um: Pair,
) -> Program:
    """Return the program: zero, approach, zero, contact, ``pressing``, unload and return."""
    first_um, second_um = request.stand_offs_um
    back_um = max(at - start for at, start in zip(request.furthest_um, starts_um, strict=True))
    approach_s = move_duration(
        max(abs(first_um - starts_um[0]), abs(second_um - starts_um[1])),
        request.approach_um_per_s,
    )
    retreat_s = move_duration(back_um, request.approach_um_per_s)
    unload = Press("unload", request.load_s, to_mN=0.0)
    segments = (
        Rest("zero", request.zero_s, guarded=True),
        Move("approach", approach_s, guarded=True, to_um=(first_um, second_um)),
        Rest("approach", request.zero_s, guarded=True),
        *(_looked_for(request) if request.centred else ()),
        _closing(request),
        *pressing,
        unload,
        Move("retreat", retreat_s, guarded=True, to_um=homes_um),
    )
    guards = pair_guards(request, most_mN)
    return Program(segments, guards, contact_stiffness_mN_per_um=request.stiffness_mN_per_um)


def _closing(request: PairRequest) -> Seek:
    """Return a motion in which both arms close on the part at the same speed."""
    stand, furthest = request.stand_offs_um, request.furthest_um
    if request.centred:
        # Each arm moves from ``BACK_UM`` before to as far beyond: the found position is inexact.
        on_um = BACK_UM + request.contact_force_mN / request.stiffness_mN_per_um
        goals_um, way_um = (on_um, on_um), 2.0 * (BACK_UM + on_um)
    else:
        goals_um, way_um = furthest, sum(furthest) - sum(stand)
    return Seek(
        "contact",
        way_um / request.seek_um_per_s,
        to_um=goals_um,
        relative=request.centred,
        sides=(True, True),
    )


def _looked_for(request: PairRequest) -> Sequence[Segment]:
    """Return segments in which each arm in turn searches for the part and moves back."""
    stand, furthest = request.stand_offs_um, request.furthest_um
    step_s = move_duration(BACK_UM, request.approach_um_per_s)

    def seek(arm: int) -> Seek:
        seconds = 2.0 * (furthest[arm] - stand[arm]) / request.seek_um_per_s
        sides = arm == 0, arm == 1
        return Seek("centre", seconds, to_um=_of(arm, furthest[arm]), sides=sides)

    def back(arm: int) -> Move:
        return Move("centre", step_s, to_um=_of(arm, -BACK_UM), relative=True)

    both_back = Move("centre", step_s, to_um=(-BACK_UM, -BACK_UM), relative=True)
    return seek(0), back(0), seek(1), back(1), both_back


def _of(arm: int, goal_um: float) -> tuple[float | None, float | None]:
    """Return the goals of both tips if only one arm moves; None for the resting arm."""
    return (goal_um, None) if arm == 0 else (None, goal_um)
