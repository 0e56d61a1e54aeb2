"""Two driven arms: place and force of one part, each along a path of its own.

A pair strokes over its range with the part away, takes both zeros, closes, presses, and follows two
sinusoids at once that no line binds; ``centre`` looks for the part from both sides first.
"""

from dataclasses import dataclass, replace
from math import pi, sin
from typing import Literal

import numpy as np

from pincette.control.laws.two_arms import Pair, TwoArmReferences
from pincette.control.planning.profiles import Quintic, move, quintic
from pincette.engine.teaching import SPEED_FACTOR, free_range_um
from pincette.sim.plant.pair_state import PairParameters
from pincette.sim.plant.parameters import PartParameters
from pincette_study import printed
from pincette_study.closed_loop import StudyError
from pincette_study.pair_bench import FAST, SLOW, Instruments, PairBench
from pincette_study.pairs import TaughtPair

FORCE_MN, FORCE_PP_MN = 15.0, 10.0
REST_S, ZERO_S = 0.5, 1.0
APPROACH_UM_PER_S, SEEK_UM_PER_S = 40.0, 4.0
"""By which the sum of both arms closes, and by which one or both look for the part."""
STAND_OFF_UM = 6.0
TOUCH_MN = 0.8
"""Force that is taken for a touch, once three samples or 6 ms have it in the mean."""
TOUCH_S = 0.06
BACK_UM = 3.0
"""By which an arm stands back from where it has touched."""
FIRM_MN = 2.0
"""Force at which a part counts as held, and its way until then as what centring did to it."""
GROUND_SLIP_MN = 1.5
"""What the ground holds a part by in the study; see ``centre``."""
FADE_S = 1.0
MOST_SEEK_S = 20.0

Axis = Literal["first", "second", "both"]


@dataclass(frozen=True, slots=True)
class Case:
    """Two sinusoids on instruments of a rate."""

    name: str
    instruments: Instruments
    place_hz: float
    force_hz: float
    seconds: float
    """Whole cycles of both."""
    position_percent: tuple[float, float]
    force_percent: tuple[float, float]
    """What is to be reached, median and worst."""


CASES = (
    Case("0.5 Hz and 0.3 Hz at 20 ms", SLOW, 0.5, 0.3, 10.0, (0.3, 0.6), (1.5, 3.0)),
    Case("2 Hz and 1.3 Hz at 20 ms", SLOW, 2.0, 1.3, 10.0, (0.5, 1.0), (2.0, 4.0)),
    Case("10 Hz and 7 Hz at 1 ms", FAST, 10.0, 7.0, 2.0, (1.0, 2.0), (2.5, 5.0)),
)


@dataclass(frozen=True, slots=True)
class PairTrial:
    """How a pair followed both paths, as it truly was."""

    hysteresis: str
    number: int
    case: str
    position_percent: float
    """R.m.s. of q - q_r, of the peak to peak of its path, and"""
    force_percent: float
    """of F - F_r, likewise."""
    disagreement_mN: float
    """R.m.s. of F̂_1 - F̂_2, low-passed as the law's force."""


@dataclass(frozen=True, slots=True)
class CentreTrial:
    """How far centring moved a part before it was held."""

    hysteresis: str
    number: int
    off_um: float
    """By which the part lay off the middle between both arms."""
    moved_um: float
    """The furthest, until ``FIRM_MN`` were reached."""
    held_mN: float
    """At the end; the force asked for is ``FORCE_MN``."""


def track(pair: TaughtPair, case: Case, gains: dict[str, float] | None = None) -> PairTrial:
    """Press the part and follow both paths; raises StudyError where the part is never held."""
    bench = PairBench(pair, case.instruments, _lifted, gains)
    prepare(bench)
    place_um = _middle_um(bench)
    close(bench, place_um)
    press(bench, place_um, FORCE_MN)
    period_s = case.instruments.period_s
    fade, whole = round(FADE_S / period_s), round(case.seconds / period_s)
    begin = len(bench.ticks)
    for index in range(fade + whole):
        place = _wave(place_um, printed.X_PP_UM, case.place_hz, (index + 1) * period_s)
        force = _wave(FORCE_MN, FORCE_PP_MN, case.force_hz, (index + 1) * period_s)
        bench.lead(
            TwoArmReferences(
                place_um=place[0],
                force_mN=force[0],
                place_speed_um_per_s=place[1],
                place_acceleration_um_per_s2=place[2],
                force_rate_mN_per_s=force[1],
            )
        )
    bench.drive(lambda: bench.ticks[-1].voltages_V)
    seen = [tick for tick in bench.ticks[begin + fade + 1 :] if tick.wanted is not None]
    places = np.array([0.5 * (t.true_tips_um[0] - t.true_tips_um[1]) for t in seen])
    forces = np.array([0.5 * (t.true_forces_mN[0] + t.true_forces_mN[1]) for t in seen])
    wanted = [t.wanted for t in seen if t.wanted is not None]
    place_error = places - np.array([r.place_um for r in wanted])
    force_error = forces - np.array([r.force_mN for r in wanted])
    apart = np.array([t.forces_mN[0] - t.forces_mN[1] for t in seen])
    smooth = max(1, round(0.1 / period_s))
    means = np.convolve(apart, np.full(smooth, 1.0 / smooth), mode="valid")
    return PairTrial(
        pair.hysteresis,
        pair.number,
        case.name,
        100.0 * _rms(place_error) / printed.X_PP_UM,
        100.0 * _rms(force_error) / FORCE_PP_MN,
        _rms(means),
    )


def centre(pair: TaughtPair, off_um: float, slip_mN: float = GROUND_SLIP_MN) -> CentreTrial:
    """Find the part from both sides, one after the other, and close without moving it.

    The ground must hold the part by more than ``TOUCH_MN``: a loose one gives way to the first arm
    without a force that any estimator sees. It is off the middle by ``off_um``.
    """

    def lying(plant: PairParameters) -> PairParameters:
        return replace(plant, part_um=plant.part_um + off_um, ground_slip_mN=slip_mN)

    bench = PairBench(pair, SLOW, lying)
    prepare(bench)
    found: list[float] = []
    for side in (0, 1):
        away = _tips(bench)
        slope = (1.0, 0.0) if side == 0 else (0.0, 1.0)
        near = bench.plant.gap_um / 2.0 - STAND_OFF_UM - 2.0
        ready = (near, away[1]) if side == 0 else (away[0], near)
        go(bench, ready)
        touched = _seek(bench, ready, slope, (side,))
        found.append(touched[side])
        at = _tips(bench)
        back_um = touched[side] - BACK_UM
        go(bench, (back_um, at[1]) if side == 0 else (at[0], back_um))
    place_um = 0.5 * (found[0] - found[1])
    go(bench, (found[0] - BACK_UM, found[1] - BACK_UM))
    close(bench, place_um)
    press(bench, place_um, FORCE_MN)
    lay_um, furthest = bench.plant.part_um, 0.0
    for tick in bench.ticks:
        furthest = max(furthest, abs(tick.part_um - lay_um))
        if min(tick.true_forces_mN) >= FIRM_MN:
            break
    held_mN = sum(0.5 * sum(t.true_forces_mN) for t in bench.ticks[-10:]) / 10
    return CentreTrial(pair.hysteresis, pair.number, off_um, furthest, held_mN)


def prepare(bench: PairBench) -> None:
    """Stroke over the taught range with the part away, put it back, and take both zeros."""
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
    """Lead both free arms to positions, from where they are."""
    begin = _tips(bench)
    way_um = max(abs(a - b) for a, b in zip(begin, tips_um, strict=True))
    seconds = max(0.3, 1.875 * way_um / (0.5 * APPROACH_UM_PER_S))
    moves = [move(a, 0.0, b, 0.0, seconds) for a, b in zip(begin, tips_um, strict=True)]
    period_s = bench.instruments.period_s
    for index in range(round(seconds / period_s) + round(0.2 / period_s)):
        bench.lead(_free(moves, (index + 1) * period_s))


def close(bench: PairBench, place_um: float) -> None:
    """Close both arms about a place until both feel the part."""
    opening = bench.plant.gap_um - STAND_OFF_UM
    if sum(_tips(bench)) < opening - 1.0:
        go(bench, (0.5 * opening + place_um, 0.5 * opening - place_um))
    _seek(bench, _about(place_um, sum(_tips(bench))), (0.5, 0.5), (0, 1))


def press(bench: PairBench, place_um: float, force_mN: float) -> None:
    """Raise the force from what it is, and hold for a second."""
    period_s = bench.instruments.period_s
    begin_mN = sum(0.5 * sum(t.forces_mN) for t in bench.ticks[-3:]) / 3
    raised = move(begin_mN, 0.0, force_mN, 0.0, 2.0)
    for index in range(round(3.0 / period_s)):
        t_s = (index + 1) * period_s
        bench.lead(
            TwoArmReferences(
                place_um=place_um,
                force_mN=raised.position(t_s),
                force_rate_mN_per_s=raised.speed(t_s),
            )
        )


def _seek(bench: PairBench, begin: Pair, slope: Pair, sides: tuple[int, ...]) -> Pair:
    """Go on slowly until each of these sides has touched; where the tips then are, in the mean."""
    period_s = bench.instruments.period_s
    several = max(3, round(TOUCH_S / period_s))
    for index in range(round(MOST_SEEK_S / period_s)):
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


def _wave(middle: float, pp: float, hz: float, t_s: float) -> tuple[float, float, float]:
    """A sinusoid about a middle that grows to its size, with its first two derivatives."""
    step_s = 1e-4
    values = [
        0.5 * pp * quintic(at_s / FADE_S) * sin(2.0 * pi * hz * at_s)
        for at_s in (t_s - step_s, t_s, t_s + step_s)
    ]
    before, at, after = values
    return (
        middle + at,
        (after - before) / (2.0 * step_s),
        (after - 2.0 * at + before) / step_s**2,
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


def _lifted(plant: PairParameters) -> PairParameters:
    """A part that lies on the ground and is lifted once it is held."""
    part = PartParameters(hold_mN=0.02, lift_after_s=0.5)
    return replace(plant, ground_slip_mN=GROUND_SLIP_MN, part=part)


def _about(place_um: float, opening_um: float) -> Pair:
    return 0.5 * opening_um + place_um, 0.5 * opening_um - place_um


def _middle_um(bench: PairBench) -> float:
    """Place of a part in the middle, where the arms touch it alike."""
    return bench.plant.part_um - 0.5 * bench.plant.gap_um


def _tips(bench: PairBench) -> Pair:
    """Where the arms are, in the mean of the newest samples."""
    last = bench.ticks[-5:]
    one, two = (sum(t.tips_um[arm] for t in last) / len(last) for arm in (0, 1))
    return one, two


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
