"""Motion of both arms over substeps, in pieces if the contact changes."""

from collections.abc import MutableSequence, Sequence

from pincette.sim.plant.arm_modes import magnitude
from pincette.sim.plant.changes import pass_pieces, sprung_back
from pincette.sim.plant.contact import static_force_mN
from pincette.sim.plant.motion import Motion, MotionConstants


def pass_substeps(
    k: MotionConstants,
    m: Motion,
    rests_um: Sequence[float],
    dents_um: MutableSequence[float],
    positions_um: MutableSequence[float],
) -> Motion:
    """Change x_f to each of ``rests_um`` in turn, each within one substep.

    ``dents_um`` is scratch memory, as long as ``rests_um`` if the faces of a part can be pressed
    in. ``positions_um`` receives the position of the tip after each substep, unless it is empty.
    """
    done, count = 0, len(rests_um)
    while done < count:
        if m.joined and _presses(k):
            _press(k, m, rests_um, dents_um, done)
        # A dent that recovers depends on the motion of the arms, so it is updated after every
        # substep.
        springs = not m.joined and m.dent_um != 0.0
        last = done + 1 if springs else count
        m, done = _pass_undisturbed(k, m, rests_um, dents_um, positions_um, done, last)
        if done < last:
            m = pass_pieces(k, m, rests_um[done])
            done += 1
        elif springs:
            m = Motion(m.w, m.rest_um, m.joined, m.there, sprung_back(k, m))
        if len(positions_um) > 0:
            positions_um[done - 1] = _tip_um(k, m)
    return m


def _pass_undisturbed(
    k: MotionConstants,
    m: Motion,
    rests_um: Sequence[float],
    dents_um: Sequence[float],
    positions_um: MutableSequence[float],
    first: int,
    last: int,
) -> tuple[Motion, int]:
    """Compute whole substeps from ``first`` to ``last``, or until the contact may change.

    Also returns the index of the first substep that was not computed; the dents have been updated
    for it.
    """
    (a, b, c), rest_um, joined, there, dent_um = m
    three, with_positions, presses = k.passive_moves, len(positions_um) > 0, joined and _presses(k)
    way = k.joined if joined else k.apart
    step = k.joined_step if joined else k.apart_step
    factors, pushes, most = step.factors, step.pushes, way.most_watched
    dented = way.pushed_by_offset
    e, f, g = factors[0], factors[1], factors[2]
    p, q, r = pushes[0], pushes[1], pushes[2]
    # Margin at rest and largest amplitude of the modes, both in µm; joined, the margin is a force.
    side, scale = (1.0, k.compliance_um_per_mN) if joined else (-1.0, 1.0)
    extra_um = k.pull_off_mN * k.compliance_um_per_mN if joined else 0.0
    most_a, most_b, most_c = scale * most[0], scale * most[1], scale * most[2]
    most_pushed = scale * way.most_by_input
    offset_um = k.contact_um + dent_um
    begin_um = side * (rest_um - offset_um) + extra_um
    for index in range(first, last):
        goal_um = rests_um[index]
        if presses:
            pressed_um = dents_um[index] - dent_um
            a, b = a - dented[0] * pressed_um, b - dented[1] * pressed_um
            dent_um = dents_um[index]
            offset_um = k.contact_um + dent_um
            begin_um = side * (rest_um - offset_um) + extra_um
        moved_um = goal_um - rest_um
        end_um = side * (goal_um - offset_um) + extra_um
        if there:
            least_um = min(begin_um, end_um) - most_pushed * abs(moved_um)
            # |Re w| + |Im w| is an upper bound of |w|, and faster to compute.
            reach_um = most_a * (abs(a.real) + abs(a.imag)) + most_b * (abs(b.real) + abs(b.imag))
            if three:
                reach_um += most_c * (abs(c.real) + abs(c.imag))
            if not reach_um < least_um:
                reach_um = most_a * magnitude(a) + most_b * magnitude(b) + most_c * magnitude(c)
                if not reach_um < least_um:
                    return Motion((a, b, c), rest_um, joined, there, dent_um), index
        a = e * a - p * moved_um
        b = f * b - q * moved_um
        if three:
            c = g * c - r * moved_um
        rest_um, begin_um = goal_um, end_um
        if with_positions:
            positions_um[index] = _tip_um(k, Motion((a, b, c), rest_um, joined, there, dent_um))
    return Motion((a, b, c), rest_um, joined, there, dent_um), last


def _presses(k: MotionConstants) -> bool:
    """Return whether the faces of the part can be pressed in."""
    return k.hertz_um_per_mN23 > 0.0


def _tip_um(k: MotionConstants, m: Motion) -> float:
    tip, (a, b, c) = k.joined.tip if m.joined else k.apart.tip, m.w
    p, q, r = tip[0], tip[1], tip[2]
    swing = p.real * a.real - p.imag * a.imag
    swing += q.real * b.real - q.imag * b.imag
    if k.passive_moves:
        swing += r.real * c.real - r.imag * c.imag
    x_um = m.rest_um + 2.0 * swing
    if m.joined:
        over_um = m.rest_um - (k.contact_um + m.dent_um)
        x_um -= k.tip_compliance_um_per_mN * (over_um / k.compliance_um_per_mN)
    return x_um


def _press(
    k: MotionConstants,
    m: Motion,
    rests_um: Sequence[float],
    dents_um: MutableSequence[float],
    first: int,
) -> None:
    """Compute dents of faces that follow the force at rest, until a face separates."""
    compliance, hertz = k.compliance_um_per_mN, k.hertz_um_per_mN23
    rest_um, dent_um = m.rest_um, m.dent_um
    for index in range(first, len(rests_um)):
        overlap_um = rest_um - k.contact_um
        static_mN = static_force_mN(overlap_um, compliance, hertz)
        goal_um = max(0.0, overlap_um - compliance * static_mN)
        dent_um += (dent_um - goal_um) * k.pressing
        dents_um[index] = dent_um
        rest_um = rests_um[index]
