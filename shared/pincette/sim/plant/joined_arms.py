"""Arms with separate modes, and a part between them that they can touch and leave; pure.

The motion of the arms, apart or joined, is computed exactly from their modes. The part is rigid and
lies against the passive arm; first contact is at x - y = x_b. Bounds from the amplitudes of the
modes show whether the arm can touch the part (x - y reaches the part) or leave it (F falls below
minus the pull-off force) within a substep. If so, the substep is divided into pieces, and the time
of the change is found by the secant method.

    touch   both tips get one speed by an impulse, which keeps the momentum and takes energy
    leave   nothing jumps
    Hertz   the faces are pressed in by δ(F) of the force at rest, followed within ``PRESS_S``;
            fed from the input alone, it cannot feed an oscillation

A lifted part is lost if the force falls below the carrying force, and any part breaks above its
limit; after that there is nothing to touch.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from pincette.sim.plant.adhesion import bridged_pull_mN, clung, pulled_um, strength_mN
from pincette.sim.plant.arms import arms_of
from pincette.sim.plant.arms_substeps import pass_substeps
from pincette.sim.plant.changes import change
from pincette.sim.plant.contact import static_force_mN
from pincette.sim.plant.motion import (
    Motion,
    MotionConstants,
    Tips,
    force_mN,
    motion_constants,
    motion_of,
    tips_of,
)
from pincette.sim.plant.parameters import PartParameters, PlantParameters
from pincette.sim.plant.state import Event, PlantState


def move_arms(
    p: PlantParameters,
    state: PlantState,
    dt_s: float,
    start_um: float,
    rests_um: Sequence[float],
    *,
    with_positions: bool = False,
) -> tuple[PlantState, list[float]]:
    """Advance substeps of equal length, with x_f from ``start_um`` to each value.

    Also returns the position after each substep if ``with_positions`` is true. ``state.elapsed_s``
    is the time at the end.
    """
    k = motion_constants(p, dt_s)
    if p.part.clings:
        k = k._replace(pull_off_mN=strength_mN(p.part, state))
        start_um = pulled_um(p, state, start_um)
        rests_um = [pulled_um(p, state, rest_um) for rest_um in rests_um]
    motion = motion_of(k, tips(state), start_um, there=touchable(p, state))
    positions_um = [0.0] * (len(rests_um) if with_positions else 0)
    dents_um = [0.0] * len(rests_um)
    if not p.part.may_go or state.part != "there":
        motion = pass_substeps(k, motion, rests_um, dents_um, positions_um)
        after = _put_into(p, k, motion, state, dt_s * len(rests_um))
        return (after.held(state.held_s, None) if p.part.may_go else after), positions_um
    begin_s = state.elapsed_s - len(rests_um) * dt_s
    held_s, event = state.held_s, None
    place_um = [0.0] * (1 if with_positions else 0)
    for number, rest_um in enumerate(rests_um, start=1):
        motion = pass_substeps(k, motion, (rest_um,), dents_um, place_um)
        positions_um[number - 1 : number] = place_um
        if event is None:
            now_s = begin_s + number * dt_s
            held_s, event = part_event(p.part, held_s, force_mN(k, motion), dt_s, now_s)
            if event is not None:
                motion = without_part(k, motion)
    after = _put_into(p, k, motion, state, dt_s * len(rests_um))
    return after.held(held_s, event), positions_um


def _put_into(
    p: PlantParameters, k: MotionConstants, motion: Motion, state: PlantState, dt_s: float
) -> PlantState:
    """Return the state after a motion of ``dt_s``, with the adhesion to the arm updated."""
    after = put_into(k, motion, state)
    return clung(p, after, dt_s, force_mN(k, motion)) if p.part.clings else after


def tips(state: PlantState) -> Tips:
    """Return positions and speeds of the arms in a state."""
    second_um, second_speed = state.second_um, state.second_speed_um_per_s
    values = (
        state.x_um - second_um,
        second_um,
        state.passive_um,
        state.speed_um_per_s - second_speed,
        second_speed,
        state.passive_speed_um_per_s,
    )
    return Tips(values, state.joined, state.dent_um)


def touchable(p: PlantParameters, state: PlantState) -> bool:
    """Return whether there is a part that can be touched."""
    return state.part == "there" and p.environment_stiffness_mN_per_um > 0.0


def put_into(k: MotionConstants, motion: Motion, state: PlantState) -> PlantState:
    """Return the state with the positions and speeds of a motion."""
    found = tips_of(k, motion)
    first, second, y_um, first_speed, second_speed, y_speed = found.values
    return replace(
        state,
        x_um=first + second,
        speed_um_per_s=first_speed + second_speed,
        second_um=second,
        second_speed_um_per_s=second_speed,
        passive_um=y_um,
        passive_speed_um_per_s=y_speed,
        joined=found.joined,
        dent_um=found.dent_um,
    )


def without_part(k: MotionConstants, motion: Motion) -> Motion:
    """Return the motion without a part; the arms continue from their positions."""
    if motion.joined:
        motion = change(k, motion)
    return Motion(motion.w, motion.rest_um, motion.joined, False, 0.0)


def rest_arms(p: PlantParameters, state: PlantState, dt_s: float, rest_um: float) -> PlantState:
    """Return the arms at their equilibrium after ``dt_s`` with creep only."""
    arms, strength, free_um = arms_of(p), p.part.pull_off_mN, rest_um
    if p.part.clings:
        strength, rest_um = strength_mN(p.part, state), pulled_um(p, state, free_um)
    there = state.part == "there" and arms.passive_stiffness_mN_per_um > 0.0
    overlap_um = rest_um - p.contact_um
    force_mN = static_force_mN(
        max(0.0, overlap_um), arms.compliance_um_per_mN, p.part.hertz_um_per_mN23
    )
    dent_um = max(0.0, overlap_um - arms.compliance_um_per_mN * force_mN)
    pulled_mN = overlap_um / arms.compliance_um_per_mN
    joined = there and (overlap_um > 0.0 or (state.joined and pulled_mN >= -strength))
    if not joined:
        force_mN, dent_um = 0.0, 0.0
    elif overlap_um < 0.0:
        force_mN = pulled_mN
    x_um = rest_um - p.compliance_um_per_mN * force_mN
    after = replace(
        state,
        x_um=x_um,
        speed_um_per_s=0.0,
        second_um=p.second_share * x_um,
        second_speed_um_per_s=0.0,
        passive_um=x_um - p.contact_um - dent_um if joined else 0.0,
        passive_speed_um_per_s=0.0,
        joined=joined,
        dent_um=dent_um,
    )
    if p.part.clings:
        after = clung(p, after, dt_s, force_mN)
        if after.bond_used >= 1.0 > state.bond_used:
            return rest_arms(p, after, 0.0, free_um)
    if after.part != "there" or not p.part.may_go:
        return after
    held_s, event = part_event(p.part, after.held_s, force_mN, dt_s, after.elapsed_s)
    after = after.held(held_s, event)
    return after if event is None else rest_arms(p, after, dt_s, free_um)


def arms_force_mN(p: PlantParameters, state: PlantState, rest_um: float) -> float:
    """Return the contact force with x_f at ``rest_um``, in mN.

    The force is negative if the part sticks and is pulled.
    """
    if not state.joined:
        return 0.0 - bridged_pull_mN(p, state, rest_um)
    k = motion_constants(p, p.substep_s)
    return force_mN(k, motion_of(k, tips(state), rest_um, there=touchable(p, state)))


def part_event(
    part: PartParameters, held_s: float, force_mN: float, dt_s: float, now_s: float
) -> tuple[float, Event | None]:
    """Return how long the force has carried the part after ``dt_s``, and its fall or break, if any.

    A part counts as lifted once the force has carried it, F >= weight/(2µ), for ``lift_after_s``.
    """
    if force_mN > part.break_mN:
        text = f"the part broke: {force_mN:.3f} mN are above {part.break_mN:.3f} mN"
        return 0.0, Event(now_s, "broken", text)
    if force_mN >= part.hold_mN:
        return held_s + dt_s, None
    if held_s < part.lift_after_s:
        return 0.0, None
    text = (
        f"the part fell: {force_mN:.4f} mN are below the {part.hold_mN:.4f} mN needed to carry it"
    )
    return 0.0, Event(now_s, "lost", text)
