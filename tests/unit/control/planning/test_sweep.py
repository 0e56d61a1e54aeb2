"""Swept sines: frequency, amplitude, rest at both ends, and what is refused."""

from math import log, pi

import numpy as np
import pytest
from msgspec.structs import replace

from pincette.control.planning.sweep import Sweep
from pincette.control.planning.swept_voltages import SweptVoltages

SWEEP = Sweep(5.0, 800.0, 4.0, 0.05, 20_000.0)


def test_a_sweep_starts_and_ends_at_rest_with_constant_amplitude() -> None:
    wave = np.array(SweptVoltages(SWEEP, 1.5)[:])
    assert wave.size == 80_001
    assert wave[0] == wave[-1] == 1.5
    assert np.max(np.abs(wave - 1.5)) == pytest.approx(0.05, rel=1e-3)
    assert abs(wave[1] - 1.5) < 1e-7


@pytest.mark.parametrize("t_s", [1.0, 2.0, 3.0])
def test_the_frequency_rises_by_a_constant_factor(t_s: float) -> None:
    wave = np.array(SweptVoltages(SWEEP, 0.0)[:])
    crossings = np.flatnonzero((wave[:-1] < 0.0) & (wave[1:] >= 0.0)) / SWEEP.rate_hz
    after = int(np.searchsorted(crossings, t_s))
    wanted_hz = 5.0 * 160.0 ** (crossings[after] / 4.0)
    period_s = crossings[after + 1] - crossings[after - 1]
    assert 2.0 / period_s == pytest.approx(wanted_hz, rel=0.01)


def test_a_sweep_spends_the_same_time_in_every_octave() -> None:
    wave = np.array(SweptVoltages(SWEEP, 0.0)[:])
    turns = np.count_nonzero((wave[:-1] < 0.0) & (wave[1:] >= 0.0))
    assert turns == pytest.approx(795.0 * 4.0 / log(160.0), abs=2)


def test_the_slew_of_a_sweep_is_that_at_its_highest_frequency() -> None:
    steps = np.abs(np.diff(SweptVoltages(replace(SWEEP, taper_s=0.01), 0.0)[:])) * SWEEP.rate_hz
    assert SWEEP.slew_V_per_s == 2.0 * pi * 800.0 * 0.05
    assert np.max(steps) == pytest.approx(SWEEP.slew_V_per_s, rel=0.02)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"to_hz": 5.0}, "the first must be below the second"),
        ({"rate_hz": 3_000.0}, "at least 4 per cycle, 3200.0 per s"),
        ({"taper_s": 2.1}, "taper of 2.1 s at both ends of a sweep of 4.0 s"),
        ({"duration_s": 200.0}, "more than 2000000 samples"),
        ({"amplitude_V": 0.0}, "amplitude of the sweep = 0.0 V"),
        ({"from_hz": float("nan")}, "lowest frequency of the sweep"),
    ],
)
def test_impossible_sweeps_are_refused(changes: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(SWEEP, **changes)
