"""Position and force of one part on separate paths, and centring of a part.

A pair strokes over its range without the part, zeroes both forces, closes, presses, and follows two
independent sinusoids at the same time; ``centre`` first searches for the part from both sides.
"""

from dataclasses import dataclass, replace
from math import pi, sin

import numpy as np

from pincette.control.laws.two_arms import TwoArmReferences
from pincette.control.planning.profiles import quintic
from pincette.sim.plant.pair_state import PairParameters
from pincette.sim.plant.parameters import PartParameters
from pincette_study import printed
from pincette_study.closed_loop import rms
from pincette_study.two_arms.bench import PairBench
from pincette_study.two_arms.course import close, go, prepare, press, seek, tips
from pincette_study.two_arms.pairs import FAST, SLOW, Instruments, TaughtPair

FORCE_MN, FORCE_PP_MN = 15.0, 10.0
BACK_UM = 3.0
"""Distance in µm by which an arm retracts after its contact."""
FIRM_MN = 2.0
"""Force in mN from which a part counts as held. Its motion until then is attributed to centring."""
MOST_OFF_UM = 5.0
"""Largest distance of a part from the middle, in µm."""
GROUND_SLIP_MN = 1.5
"""Force in mN with which the ground holds a part in the study; see ``centre``."""
FADE_S = 1.0
"""Time over which both sinusoids grow to their amplitude, in s."""
DISAGREEMENT_S = 0.1
"""Time over which the difference of both forces is averaged, in s."""


@dataclass(frozen=True, slots=True)
class Case:
    """Two sinusoids, and the instruments to use."""

    name: str
    instruments: Instruments
    place_hz: float
    force_hz: float
    seconds: float
    """Duration in s, which contains whole cycles of both sinusoids."""
    position_percent: tuple[float, float]
    force_percent: tuple[float, float]
    """Limits of the force error in per cent, for the median and the worst value. The limits of the
    position error, ``position_percent``, have the same form.
    """


CASES = (
    Case("0.5 Hz and 0.3 Hz at 20 ms", SLOW, 0.5, 0.3, 10.0, (0.3, 0.6), (1.5, 3.0)),
    Case("2 Hz and 1.3 Hz at 20 ms", SLOW, 2.0, 1.3, 10.0, (0.5, 1.0), (2.0, 4.0)),
    Case("10 Hz and 7 Hz at 1 ms", FAST, 10.0, 7.0, 2.0, (1.0, 2.0), (2.5, 5.0)),
)


@dataclass(frozen=True, slots=True)
class PairTrial:
    """True errors of a pair on both paths."""

    hysteresis: str
    number: int
    case: str
    position_percent: float
    """R.m.s. of q - q_r, in per cent of the peak to peak of its path."""
    force_percent: float
    """R.m.s. of F - F_r, in per cent of the peak to peak of its path."""
    disagreement_mN: float
    """R.m.s. of F̂_1 - F̂_2 in mN, low-passed like the force of the law."""


@dataclass(frozen=True, slots=True)
class CentreTrial:
    """Motion of a part during centring, before it was held."""

    hysteresis: str
    number: int
    off_um: float
    """Initial distance of the part from the middle between both arms, in µm."""
    moved_um: float
    """Largest motion of the part until ``FIRM_MN`` was reached, in µm."""
    held_mN: float
    """Force at the end, in mN; the requested force is ``FORCE_MN``."""


def track(pair: TaughtPair, case: Case, *, dry_run: bool = False) -> PairTrial:
    """Press the part and follow both paths; raises StudyError if this is refused or fails.

    With ``dry_run`` the voltages of a first run are repeated without the part. The model errors
    found in this way are used in a second run, whose errors are returned.
    """
    bench = PairBench(pair, case.instruments, _lifted)
    _follow(bench, case)
    if dry_run:
        known = bench.replayed()
        bench = PairBench(pair, case.instruments, _lifted, known, run=2)
        _follow(bench, case)
    period_s = case.instruments.period_s
    begin = bench.begun["track"] + round(FADE_S / period_s) + 1
    seen = [tick for tick in bench.ticks[begin:] if tick.wanted is not None]
    places = np.array([0.5 * (t.true_tips_um[0] - t.true_tips_um[1]) for t in seen])
    forces = np.array([0.5 * (t.true_forces_mN[0] + t.true_forces_mN[1]) for t in seen])
    wanted = [t.wanted for t in seen if t.wanted is not None]
    apart = np.array([t.forces_mN[0] - t.forces_mN[1] for t in seen])
    several = max(1, round(DISAGREEMENT_S / period_s))
    means = np.convolve(apart, np.full(several, 1.0 / several), mode="valid")
    return PairTrial(
        pair.hysteresis,
        pair.number,
        case.name,
        100.0 * rms(places - np.array([r.place_um for r in wanted])) / printed.X_PP_UM,
        100.0 * rms(forces - np.array([r.force_mN for r in wanted])) / FORCE_PP_MN,
        rms(means),
    )


def _follow(bench: PairBench, case: Case) -> None:
    """Grip in the middle, and follow both sinusoids over whole cycles."""
    prepare(bench)
    place_um = bench.plant.part_um - 0.5 * bench.plant.gap_um
    close(bench, place_um)
    press(bench, place_um, FORCE_MN)
    bench.begin("track")
    period_s = case.instruments.period_s
    for index in range(round((FADE_S + case.seconds) / period_s)):
        at_s = (index + 1) * period_s
        place, speed, acceleration = _wave(place_um, printed.X_PP_UM, case.place_hz, at_s)
        force, rate, _ = _wave(FORCE_MN, FORCE_PP_MN, case.force_hz, at_s)
        bench.lead(
            TwoArmReferences(
                place_um=place,
                force_mN=force,
                place_speed_um_per_s=speed,
                place_acceleration_um_per_s2=acceleration,
                force_rate_mN_per_s=rate,
            )
        )
    bench.drive(lambda: bench.ticks[-1].voltages_V)


def centre(pair: TaughtPair, off_um: float, slip_mN: float = GROUND_SLIP_MN) -> CentreTrial:
    """Find the part from both sides in turn, and close without moving it.

    The ground must hold the part with more than ``TOUCH_MN``: the first arm would push a loose part
    away without a detectable force. The part is ``off_um`` away from the middle.
    """

    def lying(plant: PairParameters) -> PairParameters:
        return replace(plant, part_um=plant.part_um + off_um, ground_slip_mN=slip_mN)

    bench = PairBench(pair, SLOW, lying)
    prepare(bench)
    found: list[float] = []
    for side in (0, 1):
        away = tips(bench)
        slope = (1.0, 0.0) if side == 0 else (0.0, 1.0)
        near = 0.5 * bench.plant.gap_um - MOST_OFF_UM - BACK_UM
        ready = (near, away[1]) if side == 0 else (away[0], near)
        go(bench, ready)
        touched = seek(bench, ready, slope, (side,), 2.0 * (MOST_OFF_UM + BACK_UM))
        found.append(touched[side])
        at = tips(bench)
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


def _wave(middle: float, pp: float, hz: float, t_s: float) -> tuple[float, float, float]:
    """Return a growing sinusoid about a middle value, with its first two derivatives."""
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


def _lifted(plant: PairParameters) -> PairParameters:
    """Return the plant with a part that lies on the ground and is lifted once it is held."""
    part = PartParameters(hold_mN=0.02, lift_after_s=0.5)
    return replace(plant, ground_slip_mN=GROUND_SLIP_MN, part=part)
