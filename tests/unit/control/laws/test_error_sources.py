"""Errors with known causes are attributed to those causes."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray

from pincette.control.laws.error_sources import CAUSES, LEAST, Sources, Tracked, error_sources

TICKS, CYCLES, K_E = 50, 8, 2.0
N = TICKS * CYCLES
SIGMA_UM = 0.03
Column = NDArray[np.float64]


def perfect() -> Tracked:
    """A swing of 8 µm, tracked without any error."""
    swing: Column = 4.0 * np.sin(2.0 * pi * np.arange(N) / TICKS)
    zeros: Column = np.zeros(N)
    return Tracked(
        x_um=swing,
        x_r_um=swing,
        x_d_um=swing,
        learned_um=zeros,
        force_mN=K_E * swing,
        force_r_mN=K_E * swing,
        standard_uncertainty_mN=zeros,
        limited=np.zeros(N, dtype=np.bool_),
        cycle_ticks=TICKS,
        stiffness_mN_per_um=K_E,
        noise_um=SIGMA_UM,
    )


def moved(seen: Tracked, by_um: Column) -> Tracked:
    """The arm deviates from its target, and so does the force of the part."""
    return replace(seen, x_um=seen.x_um + by_um, force_mN=seen.force_mN + K_E * by_um)


def others(found: Sources, *causes: str) -> float:
    return max(found.by_cause[cause] for cause in CAUSES if cause not in causes)


def rms(values: Column) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_without_an_error_there_are_no_error_sources() -> None:
    for found in error_sources(perfect()):
        assert found.total == pytest.approx(0.0, abs=1e-12)
        assert set(found.by_cause) == set(CAUSES)


@pytest.mark.parametrize("cycle_ticks", [TICKS, 0])
def test_errors_that_do_not_repeat_are_attributed_to_noise(cycle_ticks: int) -> None:
    noise_um = np.random.default_rng(1).normal(0.0, 0.05, N)
    seen = replace(moved(perfect(), noise_um), cycle_ticks=cycle_ticks)
    position, force = error_sources(seen)
    assert position.largest == force.largest == "noise"
    assert position.by_cause["noise"] == pytest.approx(rms(noise_um), rel=0.05)
    assert others(position, "noise") < 0.015
    # The part of the force that the sensor's own noise cannot have caused.
    moved_um = (rms(noise_um) ** 2 - SIGMA_UM**2) ** 0.5
    assert force.by_cause["noise"] == pytest.approx(K_E * moved_um, rel=0.1)


def test_the_sensors_own_noise_moves_nothing() -> None:
    seen = perfect()
    noise_um = np.random.default_rng(2).normal(0.0, SIGMA_UM, N)
    seen = replace(seen, x_um=seen.x_um + noise_um, force_mN=seen.force_mN - noise_um / 0.46)
    position, force = error_sources(seen)
    assert position.largest == "noise"
    assert force.by_cause["noise"] < 0.4 * K_E * SIGMA_UM


def test_errors_proportional_to_the_speed_are_attributed_to_lag() -> None:
    seen = perfect()
    by_um = -0.4 * np.gradient(seen.x_r_um)
    position, force = error_sources(moved(seen, by_um))
    assert position.largest == force.largest == "lag"
    assert position.by_cause["lag"] == pytest.approx(rms(by_um), rel=0.01)
    assert force.by_cause["lag"] == pytest.approx(K_E * rms(by_um), rel=0.01)
    assert position.total == pytest.approx(rms(by_um), rel=0.01)
    assert others(position, "lag") < 0.01 * rms(by_um)


def test_repeating_errors_that_do_not_depend_on_speed_are_attributed_to_the_response() -> None:
    noise_um = np.random.default_rng(3).normal(0.0, SIGMA_UM, N)
    by_um = 0.1 * np.sin(6.0 * pi * np.arange(N) / TICKS)
    position, _ = error_sources(moved(perfect(), by_um + noise_um))
    assert position.largest == "response"
    assert position.by_cause["response"] == pytest.approx(rms(by_um), rel=0.05)
    assert position.by_cause["noise"] == pytest.approx(SIGMA_UM, rel=0.1)
    assert others(position, "response", "noise") < 0.005


def test_noise_left_in_a_mean_over_cycles_is_not_attributed_to_the_response() -> None:
    noise_um = np.random.default_rng(4).normal(0.0, 0.1, 2 * TICKS)
    whole = perfect()
    names = [name for name in Tracked.__slots__ if np.ndim(getattr(whole, name))]
    seen = replace(whole, **{name: getattr(whole, name)[: 2 * TICKS] for name in names})
    position, _ = error_sources(moved(seen, noise_um))
    assert position.by_cause["noise"] == pytest.approx(0.1, rel=0.2)
    assert position.by_cause["response"] < 0.04


def test_a_force_off_the_line_is_attributed_to_the_contact_line() -> None:
    seen, gave_way = perfect(), 0.1
    # The part is stiffer than the line states: F̂ is too large by a share of it.
    off_mN = 0.05 * K_E * seen.x_r_um
    gives_um = -gave_way * off_mN
    seen = replace(
        seen,
        x_d_um=seen.x_r_um + gives_um,
        x_um=seen.x_r_um + gives_um,
        force_mN=seen.force_r_mN + off_mN + K_E * gives_um,
    )
    position, force = error_sources(seen)
    assert position.largest == force.largest == "contact_line"
    assert position.by_cause["contact_line"] == pytest.approx(rms(gives_um), rel=1e-6)
    assert force.by_cause["contact_line"] == pytest.approx((1.0 - gave_way * K_E) * rms(off_mN))
    assert others(position, "contact_line") < 1e-6


def test_a_late_estimate_is_not_attributed_to_the_contact_line() -> None:
    seen = perfect()
    # F̂ is late: the impedance yields by that error, and the law misses its target by the same.
    late_mN = -0.1 * K_E * np.gradient(seen.x_r_um)
    gives_um = -0.1 * late_mN
    seen = replace(seen, x_d_um=seen.x_r_um + gives_um, force_mN=seen.force_r_mN + late_mN)
    position, force = error_sources(seen)
    assert position.total == pytest.approx(0.0, abs=1e-12)
    assert max(position.by_cause.values()) < 1e-6
    # The law's correction is read off the line, only at the ends of the record.
    assert force.by_cause["contact_line"] < 0.1 * rms(late_mN)


def test_learned_corrections_are_not_attributed_to_the_impedance() -> None:
    seen = perfect()
    learned_um = 0.2 * np.cos(2.0 * pi * np.arange(N) / TICKS)
    # The law misses by what is learned: the arm is where it should be.
    seen = replace(seen, x_d_um=seen.x_r_um + learned_um, learned_um=learned_um)
    for found in error_sources(seen):
        assert max(found.by_cause.values()) < 1e-9


def test_the_stated_uncertainty_of_the_force_is_attributed_to_the_response() -> None:
    seen = replace(perfect(), standard_uncertainty_mN=np.full(N, 0.3))
    position, force = error_sources(seen)
    assert position.total == 0.0
    assert force.largest == "response"
    assert force.total == pytest.approx(0.3)


def test_samples_at_a_limit_are_attributed_to_the_limit_only() -> None:
    seen = perfect()
    limited = np.zeros(N, dtype=np.bool_)
    limited[120:140] = True
    by_um = np.where(limited, -1.0, 0.0)
    position, force = error_sources(replace(moved(seen, by_um), limited=limited))
    assert position.largest == force.largest == "limits"
    assert position.by_cause["limits"] == pytest.approx(rms(by_um))
    assert others(position, "limits") < 1e-9


def test_a_slow_drift_during_a_hold_is_attributed_to_the_response() -> None:
    rest: Column = np.full(N, 5.0)
    drift_um = np.linspace(0.0, 0.4, N)
    noise_um = np.random.default_rng(5).normal(0.0, SIGMA_UM, N)
    seen = replace(
        perfect(),
        x_um=rest + drift_um + noise_um,
        x_r_um=rest,
        x_d_um=rest,
        force_mN=K_E * (rest + drift_um),
        force_r_mN=K_E * rest,
        cycle_ticks=0,
    )
    position, _ = error_sources(seen)
    assert position.largest == "response"
    assert position.by_cause["response"] == pytest.approx(rms(drift_um), rel=0.05)
    assert position.by_cause["noise"] == pytest.approx(SIGMA_UM, rel=0.15)
    assert position.by_cause["lag"] == 0.0


def test_uninformative_samples_are_refused() -> None:
    few = {name: np.zeros(LEAST - 1) for name in ("x_um", "x_r_um", "x_d_um", "learned_um")}
    with pytest.raises(ValueError, match="at least 10"):
        replace(perfect(), **few)
    with pytest.raises(ValueError, match="not a whole number of cycles of 60"):
        replace(perfect(), cycle_ticks=60)
    with pytest.raises(ValueError, match="contact stiffness K_e"):
        replace(perfect(), stiffness_mN_per_um=0.0)
