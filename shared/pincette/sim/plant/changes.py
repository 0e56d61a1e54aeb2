"""Subdivision of a substep at the times at which an arm touches or separates (secant method)."""

import math

from pincette.sim.plant.arm_modes import Three, Transition, carried, deviation, transition
from pincette.sim.plant.motion import Motion, MotionConstants, Tips, motion_of, tips_of

MOST_CHANGES = 8
"""Largest number of contact changes within one piece; further ones are not detected."""
SECANTS = 4


def pass_pieces(k: MotionConstants, m: Motion, goal_um: float) -> Motion:
    """Return the motion after a substep in which the arms may touch or separate."""
    piece_s, start_um = k.dt_s / k.pieces, m.rest_um
    for number in range(1, k.pieces + 1):
        way = approached(k, number * piece_s, k.dt_s)
        m = _pass_piece(k, m, piece_s, start_um + way * (goal_um - start_um))
        m = Motion(m.w, m.rest_um, m.joined, m.there, sprung_back(k, m))
    return m


def _pass_piece(k: MotionConstants, m: Motion, dt_s: float, goal_um: float) -> Motion:
    """Return the motion after a piece in which the arms may touch or separate more than once."""
    step = _kept(k.joined_piece if m.joined else k.apart_piece)
    for _ in range(MOST_CHANGES):
        start, before = m, margin(k, m)
        opening = before <= 0.0 and not m.joined and _closing_um_per_s(k, m) <= 0.0
        m = moved_by(step, start, goal_um)
        after = margin(k, m)
        if after >= 0.0 or opening:
            return m
        m, moment_s = _change_within(k, start, dt_s, goal_um, before, after)
        dt_s -= moment_s
        if dt_s <= 0.0:
            return Motion(m.w, goal_um, m.joined, m.there, m.dent_um)
        step = _over(k, m, dt_s)
    return moved_by(step, m, goal_um)


def _change_within(
    k: MotionConstants, start: Motion, dt_s: float, goal_um: float, before: float, after: float
) -> tuple[Motion, float]:
    """Return the motion after the first change within a piece, and the time of the change, in s."""
    m, moment_s = start, 0.0
    times, margins = (0.0, dt_s), (before, after)
    for _ in range(SECANTS if before > 0.0 else 1):
        slope = (margins[1] - margins[0]) or -1.0
        moment_s = times[1] - margins[1] * (times[1] - times[0]) / slope
        moment_s = max(0.0, min(dt_s, moment_s)) if before > 0.0 else 0.0
        way_um = (goal_um - start.rest_um) * approached(k, moment_s, dt_s)
        m = moved_by(_over(k, start, moment_s), start, start.rest_um + way_um)
        times, margins = (times[1], moment_s), (margins[1], margin(k, m))
    return change(k, m), moment_s


def change(k: MotionConstants, m: Motion) -> Motion:
    """Change between apart and joined; at contact both tips get one common speed."""
    tips = tips_of(k, m)
    first, second, y_um, first_speed, second_speed, y_speed = tips.values
    dent_um = m.dent_um
    if not m.joined:
        dent_um = first + second - y_um - k.contact_um
        masses = k.inverse_masses
        of_first, of_second, of_passive = masses[0], masses[1], masses[2]
        impulse_mN_s = 0.0
        if k.passive_moves:
            closing = first_speed + second_speed - y_speed
            impulse_mN_s = closing / (of_first + of_second + of_passive)
        first_speed -= impulse_mN_s * of_first
        second_speed -= impulse_mN_s * of_second
    values = (first, second, y_um, first_speed, second_speed, y_speed)
    return motion_of(k, Tips(values, not m.joined, dent_um), m.rest_um, there=m.there)


def margin(k: MotionConstants, m: Motion) -> float:
    """Return the distance to a contact of the arms, in µm, or the force to a separation, in mN."""
    offset_um = k.contact_um + m.dent_um
    if m.joined:
        at_rest = (m.rest_um - offset_um) / k.compliance_um_per_mN + k.pull_off_mN
        return at_rest + deviation(k.joined.watched, m.w)
    return offset_um - m.rest_um - deviation(k.apart.watched, m.w)


def _closing_um_per_s(k: MotionConstants, m: Motion) -> float:
    """Return the closing speed of arms that are apart (that of x - y), in µm/s."""
    rates = k.apart.rates_per_s
    speeds: Three = (rates[0] * m.w[0], rates[1] * m.w[1], rates[2] * m.w[2])
    return deviation(k.apart.watched, speeds)


def _kept(step: Transition) -> Transition:
    """Return a copy of the transition with its own tuples."""
    factors, pushes = step.factors, step.pushes
    return Transition((factors[0], factors[1], factors[2]), (pushes[0], pushes[1], pushes[2]))


def _over(k: MotionConstants, m: Motion, dt_s: float) -> Transition:
    return transition(k.joined if m.joined else k.apart, dt_s, k.lag_s)


def sprung_back(k: MotionConstants, m: Motion) -> float:
    """Return the dent of the faces in µm; while the arms are apart, it recovers as they open."""
    if m.joined or m.dent_um == 0.0:
        return m.dent_um
    reach_um = m.rest_um + deviation(k.apart.watched, m.w)
    return max(0.0, min(m.dent_um, reach_um - k.contact_um))


def approached(k: MotionConstants, time_s: float, whole_s: float) -> float:
    """Return the fraction of its change that x_f has covered at a time within a step."""
    if k.lag_s <= 0.0:
        return 1.0
    return math.expm1(-time_s / k.lag_s) / math.expm1(-whole_s / k.lag_s)


def moved_by(step: Transition, m: Motion, rest_um: float) -> Motion:
    """Return the motion after a step in which x_f changes to ``rest_um``."""
    w = carried(step, m.w, rest_um - m.rest_um)
    return Motion(w, rest_um, m.joined, m.there, m.dent_um)
