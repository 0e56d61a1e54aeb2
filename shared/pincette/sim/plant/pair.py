"""Motion of two driven arms and one part between them; pure.

Each arm has its own hysteresis, creep and mode. The part lies on the ground, can be pushed and
squeezed, is lifted once both arms carry it, and stays on the arm whose face releases it last. If
nothing can touch, leave or slip during a substep, the motion is exact for a constant x_f
(``pair_modes``); otherwise the substep is divided into pieces, with changes at their ends.
"""

import math
from collections.abc import Sequence

from msgspec.structs import replace

from pincette.sim.plant.drive import drive
from pincette.sim.plant.joined_arms import part_event
from pincette.sim.plant.pair_modes import (
    Contact,
    Ground,
    Pair,
    PairModes,
    PairNumbers,
    finest_s,
    pair_modes,
    place_um,
    reach_of,
    rest_of,
)
from pincette.sim.plant.pair_state import (
    PairParameters,
    PairState,
    pair_forces_mN,
    pair_numbers,
    part_gone,
)
from pincette.sim.plant.state import Event, newest_events


def advance_pair(p: PairParameters, state: PairState, dt_s: float) -> PairState:
    """Advance by ``dt_s``: whole substeps, then the remaining time; results are bitwise
    reproducible.
    """
    if not 0.0 <= dt_s < math.inf:
        raise ValueError(f"dt_s = {dt_s} s: must be positive and finite")
    longest_s = min(p.first.substep_s, p.second.substep_s)
    whole = int(dt_s / longest_s + 1e-9)
    rest_s = dt_s - whole * longest_s
    for each_s, count in ((longest_s, whole), (rest_s, 1 if rest_s > 1e-9 else 0)):
        if count:
            state = _substeps(p, state, each_s, count)
    return state


def _substeps(p: PairParameters, state: PairState, dt_s: float, count: int) -> PairState:
    begin_s = state.first.elapsed_s
    arms = [
        drive(each, arm, dt_s, count)
        for each, arm in zip(p.arms, (state.first, state.second), strict=True)
    ]
    (first, rests_1, _), (second, rests_2, _) = arms
    state = replace(state, first=first, second=second)
    return move_pair(p, state, dt_s, tuple(zip(rests_1, rests_2, strict=True)), begin_s)


def move_pair(
    p: PairParameters, state: PairState, dt_s: float, rests_um: Sequence[Pair], begin_s: float = 0.0
) -> PairState:
    """Advance substeps of equal length, each towards the free positions of both arms."""
    numbers = pair_numbers(p)
    for number, rests in enumerate(rests_um, start=1):
        state = _pass_substep(p, numbers, state, dt_s, rests)
        if state.part == "there":
            state = _befallen(p, state, dt_s, begin_s + number * dt_s)
    return state


def _pass_substep(
    p: PairParameters, numbers: PairNumbers, state: PairState, dt_s: float, rests_um: Pair
) -> PairState:
    modes = pair_modes(numbers, state.contact, dt_s)
    rest = rest_of(modes, _pushes(p, numbers, modes, state, rests_um))
    if _certain(p, numbers, modes, state, rest):
        return _moved(p, modes, state, rest)
    pieces = math.ceil(dt_s / finest_s(numbers))
    for _ in range(pieces):
        modes = pair_modes(numbers, state.contact, dt_s / pieces)
        rest = rest_of(modes, _pushes(p, numbers, modes, state, rests_um))
        state = _changed(p, _moved(p, modes, state, rest), state.part_um)
    return state


def _pushes(
    p: PairParameters, numbers: PairNumbers, modes: PairModes, state: PairState, rests_um: Pair
) -> Pair:
    """Return k_i·x_f,i minus the contribution to F_i that does not depend on the tips, in mN."""
    contact, kept_um = state.contact, state.part_um
    z_um = place_um(modes, (0.0, 0.0), _load_mN(p, state), kept_um)
    face = p.face_mN_per_um
    held_1 = -face * z_um if contact.first else 0.0
    held_2 = -face * (p.gap_um - z_um) if contact.second else 0.0
    k_1, k_2 = numbers.stiffnesses
    return k_1 * rests_um[0] - held_1, k_2 * rests_um[1] - held_2


def _load_mN(p: PairParameters, state: PairState) -> float:
    """Return the terms in the balance of the part that do not depend on the tips, in mN."""
    contact = state.contact
    load_mN = p.face_mN_per_um * p.gap_um if contact.second else 0.0
    if contact.ground == Ground.HOLDS:
        return load_mN + p.ground_mN_per_um * state.anchor_um
    if contact.ground == Ground.AWAY:
        return load_mN
    return load_mN - contact.ground * p.ground_slip_mN


def _moved(p: PairParameters, modes: PairModes, state: PairState, rest: Pair) -> PairState:
    """Return the tips after the step of ``modes``, and the resulting position of the part."""
    first, second = state.first, state.second
    e = (
        first.x_um - rest[0],
        second.x_um - rest[1],
        first.speed_um_per_s,
        second.speed_um_per_s,
    )
    after = [
        row[0] * e[0] + row[1] * e[1] + row[2] * e[2] + row[3] * e[3] for row in modes.transition
    ]
    tips = rest[0] + after[0], rest[1] + after[1]
    return replace(
        state,
        first=replace(first, x_um=tips[0], speed_um_per_s=after[2]),
        second=replace(second, x_um=tips[1], speed_um_per_s=after[3]),
        part_um=place_um(modes, tips, _load_mN(p, state), state.part_um),
    )


def _certain(
    p: PairParameters, numbers: PairNumbers, modes: PairModes, state: PairState, rest: Pair
) -> bool:
    """Return whether nothing can touch, leave or slip while the tips approach their rest."""
    if state.part != "there":
        return True
    contact = state.contact
    if contact.ground in (Ground.SLIPS_UP, Ground.SLIPS_DOWN):
        return False
    e_1, e_2 = state.first.x_um - rest[0], state.second.x_um - rest[1]
    v_1, v_2 = state.first.speed_um_per_s, state.second.speed_um_per_s
    k_11, k_12, k_22 = modes.stiffness
    m_1, m_2 = numbers.masses
    twice_E = k_11 * e_1 * e_1 + 2.0 * k_12 * e_1 * e_2 + k_22 * e_2 * e_2
    amplitude = math.sqrt(twice_E + m_1 * v_1 * v_1 + m_2 * v_2 * v_2)
    z_um = place_um(modes, rest, _load_mN(p, state), state.part_um)
    by_1, by_2 = modes.place_by_x
    to_first = z_um - rest[0], (by_1 - 1.0, by_2)
    to_second = p.gap_um - z_um - rest[1], (-by_1, -by_2 - 1.0)
    for (gap_um, by_x), touches, pull_off_mN in (
        (to_first, contact.first, p.pull_off_mN[0]),
        (to_second, contact.second, p.pull_off_mN[1]),
    ):
        margin_um = pull_off_mN / p.face_mN_per_um - gap_um if touches else gap_um
        if margin_um <= reach_of(modes, by_x) * amplitude:
            return False
    if contact.ground != Ground.HOLDS or not (contact.first or contact.second):
        return True
    slack_um = p.ground_slip_mN / p.ground_mN_per_um - abs(z_um - state.anchor_um)
    return slack_um > reach_of(modes, modes.place_by_x) * amplitude


def _changed(p: PairParameters, state: PairState, before_um: float) -> PairState:
    """Update contact, separation, slip and hold from the state at the end of a piece."""
    if state.part != "there":
        return state
    contact, z = state.contact, state.part_um
    first, second = _touching(p, state)
    ground, anchor_um = contact.ground, state.anchor_um
    if ground == Ground.HOLDS:
        load_mN = p.ground_mN_per_um * (z - anchor_um)
        if abs(load_mN) > p.ground_slip_mN:
            ground = Ground.SLIPS_UP if load_mN > 0.0 else Ground.SLIPS_DOWN
    elif ground != Ground.AWAY and (z - before_um) * ground <= 0.0:
        anchor_um = z - ground * p.ground_slip_mN / p.ground_mN_per_um
        ground = Ground.HOLDS
    if not (first or second):
        if ground in (Ground.SLIPS_UP, Ground.SLIPS_DOWN):
            anchor_um = z - ground * p.ground_slip_mN / p.ground_mN_per_um
            ground = Ground.HOLDS
        if ground == Ground.HOLDS:
            # A part without mass recovers at once.
            z = anchor_um
    return replace(state, contact=Contact(first, second, ground), part_um=z, anchor_um=anchor_um)


def _touching(p: PairParameters, state: PairState) -> tuple[bool, bool]:
    """Return which faces touch from now on.

    If a part is held by faces only, both forces are equal, and the force of a single face is 0, so
    the sign of a difference does not show which face separates. For two faces their common force is
    then used, and for a single face the direction of its arm, which pushes the part forwards, or
    pulls it if it sticks.
    """
    contact, z = state.contact, state.part_um
    x_1, x_2 = state.tips_um
    off_1, off_2 = (pull_off_mN / p.face_mN_per_um for pull_off_mN in p.pull_off_mN)
    slips = contact.ground in (Ground.SLIPS_UP, Ground.SLIPS_DOWN)
    if contact.ground == Ground.AWAY or (slips and p.ground_slip_mN == 0.0):
        closed_um = x_1 + x_2 - p.gap_um
        if contact.first and contact.second:
            return 0.5 * closed_um > -off_1, 0.5 * closed_um > -off_2
        if contact.first:
            return off_1 > 0.0 or state.first.speed_um_per_s > 0.0, closed_um > 0.0
        if contact.second:
            return closed_um > 0.0, off_2 > 0.0 or state.second.speed_um_per_s > 0.0
    first = x_1 - z > (-off_1 if contact.first else 0.0)
    second = x_2 - p.gap_um + z > (-off_2 if contact.second else 0.0)
    return first, second


def _befallen(p: PairParameters, state: PairState, dt_s: float, now_s: float) -> PairState:
    """Lift, drop or break the part, depending on the smaller one of both forces."""
    if not p.part.may_go:
        return state
    contact = state.contact
    both = contact.first and contact.second
    held_s, event = state.held_s, None
    if both:
        weaker_mN = min(pair_forces_mN(p, state))
        held_s, event = part_event(p.part, held_s, weaker_mN, dt_s, now_s)
    elif contact.ground != Ground.AWAY:
        held_s = 0.0
    elif p.part.hold_mN > 0.0 or not (contact.first or contact.second):
        # A single face can carry a part without weight.
        event = Event(now_s, "lost", "the part fell: one arm does not carry it")
    if event is not None and event.what == "lost" and p.lands:
        return _landed(state, now_s)
    if event is not None:
        state = replace(state, events=newest_events(state.events, event))
        return part_gone(state, "broken" if event.what == "broken" else "lost")
    if both and contact.ground != Ground.AWAY and held_s >= p.part.lift_after_s:
        contact = Contact(first=True, second=True, ground=Ground.AWAY)
    return replace(state, held_s=held_s, contact=contact)


def _landed(state: PairState, now_s: float) -> PairState:
    """Put the part on the ground where it was released, with the faces in contact touching it."""
    z = state.part_um
    event = Event(now_s, "landed", f"the part lies on the ground again, touched at {z:.3f} µm")
    contact = Contact(state.contact.first, state.contact.second, Ground.HOLDS)
    events = newest_events(state.events, event)
    return replace(state, contact=contact, anchor_um=z, held_s=0.0, events=events)
