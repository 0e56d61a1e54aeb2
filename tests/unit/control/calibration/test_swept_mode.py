"""Identification of the mode from a noisy sweep of an arm with hysteresis, creep and a second
mode."""

import numpy as np
import pytest

from pincette.control.calibration.resonance import fit_second_order
from pincette.control.calibration.swept_mode import SweptMode, require_even_swing, swept_mode
from pincette.control.planning.sweep import Sweep
from pincette.control.planning.swept_voltages import SweptVoltages

from .bench import PERIOD_S, Bench, drawn, percent, table, truth
from .sweeping import Recorded, recorded

SWEEP = Sweep(from_hz=5.0, to_hz=800.0, duration_s=25.0, amplitude_V=0.05, rate_hz=10_000.0)


def mode_of(record: Recorded) -> SweptMode:
    return swept_mode(
        record.drive_V,
        record.x_um,
        SWEEP.rate_hz,
        from_hz=SWEEP.from_hz,
        to_hz=SWEEP.to_hz,
    )


def judge(seeds: range) -> list[list[float]]:
    """Return errors of ω_n and ζ in per cent, each with its stated uncertainty, row by row."""
    rows: list[list[float]] = []
    for seed in seeds:
        record = recorded(seed, SWEEP)
        found = mode_of(record).model
        omega_n, zeta = record.natural_frequency_rad_per_s, record.damping_ratio
        rows.append(
            [
                percent(found.natural_frequency_rad_per_s, omega_n),
                percent(found.damping_ratio, zeta),
                100.0 * found.natural_frequency_uncertainty_rad_per_s / omega_n,
                100.0 * found.damping_ratio_uncertainty / zeta,
                found.higher_modes - record.higher_modes,
            ]
        )
    print(table(" ω_n / %     ζ / %    u(ω_n)      u(ζ)    ρ - ρ_true", rows))
    return rows


def check(rows: list[list[float]]) -> None:
    worst = np.max(np.abs(np.array(rows)), axis=0)
    assert worst[0] < 0.02
    assert worst[1] < 0.5
    assert worst[4] < 0.02


def test_the_mode_of_four_rigs_is_identified() -> None:
    check(judge(range(4)))


@pytest.mark.slow
def test_the_mode_of_twenty_rigs_is_identified() -> None:
    check(judge(range(20)))


@pytest.mark.slow
def test_the_mode_of_whole_simulated_rigs_is_identified() -> None:
    """The whole plant: amplifier, drift, asymmetric hysteresis, and a played wave."""
    rows: list[list[float]] = []
    for seed in range(5):
        fast = {"bead": False, "output_lag_s": 3e-6, "output_step_V": 20.0 / 65536}
        bench = Bench(drawn(seed).model_copy(update=fast))
        bench.rig.begin_capture(SWEEP.rate_hz)
        for _ in range(50):
            bench.tick(0.0)
        bench.rig.put_out_wave(SweptVoltages(SWEEP, 0.0)[:], SWEEP.rate_hz)
        for _ in range(round((SWEEP.duration_s + 1.0) / PERIOD_S)):
            bench.rig.go_on()
        x_um, drive_V = bench.rig.drain()
        found = swept_mode(
            drive_V, x_um, SWEEP.rate_hz, from_hz=SWEEP.from_hz, to_hz=SWEEP.to_hz
        ).model
        true = truth(seed)
        rows.append(
            [
                percent(found.natural_frequency_rad_per_s, true.natural_frequency_rad_per_s),
                percent(found.damping_ratio, true.damping_ratio),
            ]
        )
    print(table(" ω_n / %     ζ / %", rows))
    worst = np.max(np.abs(np.array(rows)), axis=0)
    assert worst[0] < 0.2
    assert worst[1] < 5.0


def test_without_the_higher_modes_the_damping_is_wrong() -> None:
    record = recorded(0, SWEEP)
    found = mode_of(record)
    plain = fit_second_order(
        found.frequency_hz, (10.0 ** (found.magnitude_db / 20.0)).tolist(), to_hz=SWEEP.to_hz
    )
    with_them = abs(percent(found.model.damping_ratio, record.damping_ratio))
    without = abs(percent(plain.damping_ratio, record.damping_ratio))
    print(f"ζ errs by {with_them:.3f} % with them, {without:.3f} % without")
    assert without > 1.0
    assert with_them < 0.2 * without


def test_the_measured_frequency_response_matches_that_of_the_fitted_model() -> None:
    record = recorded(1, SWEEP)
    found = mode_of(record)
    assert found.coherence > 0.99
    assert found.residual_percent < 5.0
    assert float(np.std(found.magnitude_db - found.model_magnitude_db)) < 0.3
    assert float(np.std(found.phase_deg - found.model_phase_deg)) < 3.0
    # The voltage is held for a sample, which delays it by half of one.
    assert found.delay_s == pytest.approx(0.5 / SWEEP.rate_hz, rel=0.05)
    assert 0.0 < found.hysteresis_phase_rad < 0.1
    peak_db = float(np.max(found.magnitude_db)) - float(np.median(found.magnitude_db[:50]))
    assert peak_db == pytest.approx(-20.0 * np.log10(2.0 * record.damping_ratio), abs=0.5)


def test_a_sweep_too_short_for_its_resonance_is_refused() -> None:
    short = Sweep(from_hz=5.0, to_hz=800.0, duration_s=2.0, amplitude_V=0.05, rate_hz=10_000.0)
    record = recorded(0, short)
    with pytest.raises(ValueError, match="record a longer sweep"):
        mode_of(record)


@pytest.mark.parametrize(("place_um", "side"), [(6.0, "above"), (2.0, "above"), (-2.0, "below")])
def test_a_sweep_in_which_the_arm_hits_an_obstacle_is_refused(place_um: float, side: str) -> None:
    """Half of the values beyond a limit are missing."""
    rate_hz = 10_000.0
    t_s = np.arange(round(4.0 * rate_hz)) / rate_hz
    swing_um = 10.0 * np.exp(-(((t_s - 2.0) / 0.4) ** 2)) * np.sin(2.0 * np.pi * 380.0 * t_s)
    x_um = 5.0 + swing_um + np.random.default_rng(1).normal(0.0, 0.03, len(t_s))
    require_even_swing(x_um, rate_hz)
    wall = 5.0 + place_um
    beyond = np.maximum(0.0, np.sign(place_um) * (x_um - wall))
    with pytest.raises(ValueError, match=f"a part seems to be in the way {side} it"):
        require_even_swing(x_um - 0.5 * np.sign(place_um) * beyond, rate_hz)
