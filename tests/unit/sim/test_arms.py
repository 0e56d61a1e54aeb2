"""Modes of the arms, separate and joined, in the plant's own motion."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pincette.config import Simulation
from pincette.sim.plant import plant
from pincette.sim.plant.arms import arms_of
from pincette.sim.plant.plant import PlantParameters, PlantState
from tests.unit.sim.elaborate import PASSIVE_RAD_PER_S, SHARE, at_rest, bare_arms, moving

FINE_S = 5e-5


def _crossings_rad_per_s(values: list[float]) -> float:
    """Return the frequency of an oscillation about 0 by its upward crossings."""
    times = [
        index + before / (before - after)
        for index, (before, after) in enumerate(pairwise(values))
        if before < 0.0 <= after
    ]
    return 2.0 * math.pi * (len(times) - 1) / ((times[-1] - times[0]) * FINE_S)


def _peaks_rad_per_s(values: list[float]) -> list[float]:
    """Return the frequencies of the two highest peaks of the spectrum, lower one first."""
    count = len(values)
    spectrum = np.abs(np.fft.rfft(np.array(values) * np.hanning(count), 8 * count))
    inner = (spectrum[1:-1] > spectrum[:-2]) & (spectrum[1:-1] > spectrum[2:])
    peaks = np.flatnonzero(inner) + 1
    highest = sorted(peaks[np.argsort(spectrum[peaks])][-2:])
    return [2.0 * math.pi * float(index) / (8 * count * FINE_S) for index in highest]


def _tip_um(p: PlantParameters, state: PlantState, rest_um: float, steps: int) -> list[float]:
    return [one.x_um - rest_um for one in moving(p, state, FINE_S, steps)]


def test_a_free_arm_rings_with_its_own_first_mode(simulation: Simulation) -> None:
    p = bare_arms(simulation, substep_s=FINE_S)
    ringing = plant.set_voltage(p, plant.start(), 0.5)
    tip_um = _tip_um(p, ringing, 0.5 * p.piezo_um_per_V, 2000)
    damped = p.natural_frequency_rad_per_s * math.sqrt(1.0 - p.damping_ratio**2)
    assert _crossings_rad_per_s(tip_um) == pytest.approx(damped, rel=1e-4)


def test_the_second_mode_is_visible_in_the_ring_down(simulation: Simulation) -> None:
    p = bare_arms(simulation, substep_s=FINE_S, second_share=SHARE)
    ringing = plant.set_voltage(p, plant.start(), 0.5)
    first, second = _peaks_rad_per_s(_tip_um(p, ringing, 0.5 * p.piezo_um_per_V, 4000))
    omega = p.natural_frequency_rad_per_s
    assert first == pytest.approx(omega, rel=3e-3)
    assert second == pytest.approx(6.27 * omega, rel=3e-3)


@pytest.mark.parametrize("share", [0.0, SHARE])
def test_joined_arms_ring_with_the_eigenfrequencies_of_the_coupled_system(
    simulation: Simulation, share: float
) -> None:
    p = bare_arms(simulation, substep_s=FINE_S, second_share=share)
    held = at_rest(p, 2.4)
    assert held.joined
    nudged = plant.set_voltage(p, held, 2.41)
    rest_um = plant.advance(p, nudged, 5.0).x_um
    tip_um = _tip_um(p, nudged, rest_um, 4000)
    expected = _joined_rad_per_s(p)
    assert [abs(rate) for rate in arms_of(p).joined.rates_per_s] == pytest.approx(expected)
    if share:
        assert _peaks_rad_per_s(tip_um) == pytest.approx(expected, rel=4e-3)
    else:
        assert _crossings_rad_per_s(tip_um) == pytest.approx(expected[0], rel=1e-3)


def _joined_rad_per_s(p: PlantParameters) -> list[float]:
    """Return the undamped frequencies of the joined arms, by M·q̈ + K·q = 0."""
    shares = [1.0 - p.second_share, p.second_share] if p.second_share else [1.0]
    k = np.array([1.0 / (share * p.compliance_um_per_mN) for share in shares])
    omega = p.natural_frequency_rad_per_s * np.array([1.0, p.second_frequency_ratio])[: len(k)]
    k_p = p.environment_stiffness_mN_per_um
    mass = np.diag(k / omega**2) + k_p / PASSIVE_RAD_PER_S**2
    squares = np.linalg.eigvals(np.linalg.solve(mass, np.diag(k) + k_p))
    return sorted(np.sqrt(squares.real).tolist())


def test_two_arms_of_equal_frequency_keep_this_frequency_when_joined(
    simulation: Simulation,
) -> None:
    p = bare_arms(simulation)
    (rate,) = arms_of(p).joined.rates_per_s
    assert abs(rate) == pytest.approx(PASSIVE_RAD_PER_S, rel=1e-12)
    assert -rate.real / abs(rate) == pytest.approx(0.026, rel=1e-9)


def test_a_passive_arm_rings_after_the_part_is_removed(simulation: Simulation) -> None:
    omega = 2.0 * math.pi * 300.0
    p = bare_arms(
        simulation,
        substep_s=FINE_S,
        passive_natural_frequency_rad_per_s=omega,
        passive_damping_ratio=0.01,
    )
    gone = plant.take_part(p, at_rest(p, 2.4), "lost")
    deflections_um = [state.passive_um for state in moving(p, gone, FINE_S, 2000)]
    assert _crossings_rad_per_s(deflections_um) == pytest.approx(omega, rel=1e-3)
    assert min(deflections_um) == pytest.approx(-at_rest(p, 2.4).passive_um, rel=0.04)


def test_the_free_arm_rests_at_the_position_of_its_hysteresis_model(simulation: Simulation) -> None:
    p = replace(
        plant.plant_parameters(simulation),
        second_share=SHARE,
        creep_per_decade=0.0,
        passive_natural_frequency_rad_per_s=PASSIVE_RAD_PER_S,
        curvature_per_V=0.02,
    )
    state = plant.start()
    for voltage_V in (0.8, 0.2, 1.3, -0.6):
        state = plant.advance(p, plant.set_voltage(p, state, voltage_V), 3.0)
        u = state.voltage_V
        expected_um = p.piezo_um_per_V * u * (1.0 + 0.02 * u) - state.hysteresis_um
        assert state.x_um == pytest.approx(expected_um, abs=1e-9)
        assert state.second_um == pytest.approx(SHARE * expected_um, abs=1e-9)


@pytest.mark.parametrize("lag_s", [0.0, 3e-6, 0.0033])
def test_the_free_arms_are_exact_whatever_the_substep(simulation: Simulation, lag_s: float) -> None:
    p = bare_arms(simulation, second_share=SHARE, output_lag_s=lag_s)
    first = plant.set_voltage(p, plant.start(), 1.0)
    fine = plant.advance(replace(p, substep_s=1e-5), first, 0.0123)
    coarse = plant.advance(replace(p, substep_s=1e-3), first, 0.0123)
    assert coarse.x_um == pytest.approx(fine.x_um, abs=1e-9)
    assert coarse.second_um == pytest.approx(fine.second_um, abs=1e-9)


def test_a_weight_on_the_arm_lowers_it_by_its_compliance(simulation: Simulation) -> None:
    p = bare_arms(simulation, second_share=SHARE)
    hung = replace(p, hung_mN=8.0)
    for voltage_V in (0.0, 0.7):
        down_um = at_rest(p, voltage_V).x_um - at_rest(hung, voltage_V).x_um
        assert down_um == pytest.approx(8.0 * 0.46, abs=1e-9)
