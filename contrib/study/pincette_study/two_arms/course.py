"""Motions of a pair: strokes, zeros, approach, contact and press."""

from pincette.control.laws.two_arms import Pair, TwoArmReferences
from pincette.control.planning.profiles import PEAK_SPEED, Quintic, move
from pincette.control.stability.two_arms import assess_two_arms
from pincette.engine.teaching import SPEED_FACTOR, free_range_um
from pincette_study.closed_loop import StudyError
from pincette_study.two_arms.bench import PairBench

REST_S, ZERO_S = 0.5, 1.0
APPROACH_UM_PER_S, SEEK_UM_PER_S = 20.0, 4.0
"""Speed of each arm during its approach, and of one arm or the sum of both during the search, in
µm/s."""
STAND_OFF_UM = 6.0
"""Distance in µm between both arms and the part when the search begins."""
TOUCH_MN, TOUCH_S = 0.8, 0.06
"""Mean force in mN that counts as a contact, and the averaging time in s, at least three
samples."""
SETTLE_S = 0.2
LOAD_S, HOLD_S = 2.0, 1.0


def prepare(bench: PairBench) -> None:
    """Check the loop, stroke without the part, put it back, and zero both forces.

    Raises
    ------
    StudyError
        If the loop is not stable enough to move.
    """
    found = assess_two_arms(bench.loop)
    if found.reason:
        raise StudyError(found.reason)
    bench.without_part()
    ends = [
        tuple(end_um / rig.model.piezo_um_per_V for end_um in free_range_um(rig))
        for rig in bench.pair.arms
    ]
    arm_speed = SPEED_FACTOR * bench.pair.arms[0].grip.approach_um_per_s
    rate_V_per_s = arm_speed / bench.pair.arms[0].model.piezo_um_per_V
    at: Pair = (0.0, 0.0)
    for turn in (1, 0, 1, 0, None):
        goal = (0.0, 0.0) if turn is None else (ends[0][turn], ends[1][turn])
        at = _ramp(bench, at, goal, rate_V_per_s)
        _rest(bench, REST_S)
    bench.with_part()
    _rest(bench, REST_S)
    bench.zero(round(ZERO_S / bench.instruments.period_s))


def go(bench: PairBench, tips_um: Pair) -> None:
    """Move both free arms from their present to new positions."""
    begin = tips(bench)
    way_um = max(abs(a - b) for a, b in zip(begin, tips_um, strict=True))
    seconds = max(0.3, PEAK_SPEED * way_um / APPROACH_UM_PER_S)
    moves = [move(a, 0.0, b, 0.0, seconds) for a, b in zip(begin, tips_um, strict=True)]
    period_s = bench.instruments.period_s
    for index in range(round(seconds / period_s) + round(SETTLE_S / period_s)):
        bench.lead(_free(moves, (index + 1) * period_s))


def close(bench: PairBench, place_um: float) -> None:
    """Close both arms around a position until both touch the part; the gap is known to a few µm."""
    opening = bench.plant.gap_um - STAND_OFF_UM
    if sum(tips(bench)) < opening - 1.0:
        go(bench, (0.5 * opening + place_um, 0.5 * opening - place_um))
    seek(bench, _about(place_um, sum(tips(bench))), (0.5, 0.5), (0, 1), 3.0 * STAND_OFF_UM)


def press(bench: PairBench, place_um: float, force_mN: float) -> None:
    """Raise the force from its present value, and hold it."""
    period_s = bench.instruments.period_s
    begin_mN = sum(0.5 * sum(t.forces_mN) for t in bench.ticks[-3:]) / 3
    bench.begin("press")
    raised = move(begin_mN, 0.0, force_mN, 0.0, LOAD_S)
    for index in range(round((LOAD_S + HOLD_S) / period_s)):
        t_s = (index + 1) * period_s
        bench.lead(
            TwoArmReferences(
                place_um=place_um,
                force_mN=raised.position(t_s),
                force_rate_mN_per_s=raised.speed(t_s),
            )
        )


def seek(
    bench: PairBench, begin: Pair, slope: Pair, sides: tuple[int, ...], most_um: float
) -> Pair:
    """Move slowly until each of these sides has touched; return the mean tip positions.

    Raises StudyError if there is no contact within ``most_um``.
    """
    period_s = bench.instruments.period_s
    several = max(3, round(TOUCH_S / period_s))
    for index in range(round(most_um / (SEEK_UM_PER_S * period_s))):
        way_um = SEEK_UM_PER_S * (index + 1) * period_s
        goal = begin[0] + slope[0] * way_um, begin[1] + slope[1] * way_um
        bench.lead(
            TwoArmReferences(
                place_um=0.5 * (goal[0] - goal[1]),
                opening_um=goal[0] + goal[1],
                pressed=False,
                place_speed_um_per_s=0.5 * SEEK_UM_PER_S * (slope[0] - slope[1]),
                opening_speed_um_per_s=SEEK_UM_PER_S * (slope[0] + slope[1]),
            )
        )
        last = bench.ticks[-several:]
        forces = [sum(t.forces_mN[side] for t in last) / several for side in sides]
        if min(forces) > TOUCH_MN:
            one, two = (sum(t.tips_um[arm] for t in last) / several for arm in (0, 1))
            return one, two
    raise StudyError(f"{bench.pair.hysteresis} pair {bench.pair.number}: nothing was touched")


def _free(moves: list[Quintic], t_s: float) -> TwoArmReferences:
    (x_1, v_1, a_1), (x_2, v_2, a_2) = (
        (each.position(t_s), each.speed(t_s), each.acceleration(t_s)) for each in moves
    )
    return TwoArmReferences(
        place_um=0.5 * (x_1 - x_2),
        opening_um=x_1 + x_2,
        pressed=False,
        place_speed_um_per_s=0.5 * (v_1 - v_2),
        place_acceleration_um_per_s2=0.5 * (a_1 - a_2),
        opening_speed_um_per_s=v_1 + v_2,
    )


def _ramp(bench: PairBench, begin: Pair, goal: Pair, rate_V_per_s: float) -> Pair:
    way_V = max(abs(a - b) for a, b in zip(begin, goal, strict=True))
    count = max(1, round(way_V / rate_V_per_s / bench.instruments.period_s))
    for index in range(1, count + 1):
        share = index / count
        u = begin[0] + share * (goal[0] - begin[0]), begin[1] + share * (goal[1] - begin[1])
        bench.drive(lambda u=u: u)
    return goal


def _rest(bench: PairBench, seconds: float) -> None:
    for _ in range(round(seconds / bench.instruments.period_s)):
        bench.drive(lambda: bench.ticks[-1].voltages_V)


def _about(place_um: float, opening_um: float) -> Pair:
    return 0.5 * opening_um + place_um, 0.5 * opening_um - place_um


def tips(bench: PairBench) -> Pair:
    """Return the mean positions of the arms over the newest samples, in µm."""
    last = bench.ticks[-5:]
    one, two = (sum(t.tips_um[arm] for t in last) / len(last) for arm in (0, 1))
    return one, two
