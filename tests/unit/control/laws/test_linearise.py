"""The matrices of law and observers are those of the code, and the code is linear."""

from dataclasses import dataclass

import numpy as np
import pytest

from pincette.control.arm.plant import consistent_arm
from pincette.control.force.inverse_dynamics import inverse_dynamics
from pincette.control.force.kalman import augmented_kalman
from pincette.control.force.observers import (
    ForceObserver,
    QuasiStatic,
    QuasiStaticParameters,
    state_of,
    with_state,
)
from pincette.control.laws import law as control_law
from pincette.control.laws.definition import LawSettings
from pincette.control.stability.loop_matrix import flatten, law_block, observer_block, refill
from tests.support.laws import default_settings, law_settings, step_at
from tests.unit.control.force.exact_arm import OMEGA_N, S_P, ZETA

ARM = consistent_arm(OMEGA_N, ZETA, 19.0, S_P)
PERIOD_S = 0.005
LAWS = [
    law_settings(),
    law_settings(force_age="newest", K_P=5.0),
    law_settings(K_S=1.0, delta=10.0),
    default_settings("pbsmic", "printed"),
    default_settings("dsmifc", "consistent"),
    default_settings("dsmifc", "printed"),
]
OBSERVERS: list[ForceObserver] = [
    QuasiStatic(QuasiStaticParameters(S_P)),
    QuasiStatic(QuasiStaticParameters(S_P, 0.4, newest_voltage=True, printed_um_per_V=19.0)),
    inverse_dynamics(OMEGA_N, ZETA, S_P, period_s=0.001, filter_s=1e-3),
    augmented_kalman(OMEGA_N, ZETA, S_P, period_s=PERIOD_S, noise_um=0.03),
]


@dataclass(frozen=True, slots=True)
class Counted:
    ticks: int = 0


def stepped(settings: LawSettings, fed: list[float]) -> list[float]:
    law = control_law.build(settings, ARM, PERIOD_S, 0.03)
    template = control_law.start(law, x_um=0.0, x_r_um=0.0, force_mN=0.0, applied_V=0.0)
    after, output = step_at(
        law, refill(template, iter(fed[3:])), (fed[0], fed[1], fed[2]), (0.0, 0.0)
    )
    return [output.voltage_V, *flatten(after)]


def drawn(size: int, seed: int, scale: float = 1e-3) -> list[float]:
    return [float(value) for value in np.random.default_rng(seed).normal(size=size) * scale]


@pytest.mark.parametrize("settings", LAWS)
def test_the_matrix_of_a_law_reproduces_its_steps(settings: LawSettings) -> None:
    matrix = law_block(settings, ARM, PERIOD_S, 0.03)
    for seed in range(5):
        fed = drawn(matrix.shape[1], seed)
        scale = np.abs(matrix) @ np.abs(fed)
        assert np.all(np.abs(matrix @ fed - stepped(settings, fed)) <= 1e-12 * scale)


@pytest.mark.parametrize("settings", LAWS)
def test_the_law_is_linear(settings: LawSettings) -> None:
    size = law_block(settings, ARM, PERIOD_S, 0.03).shape[1]
    one, two = drawn(size, 1), drawn(size, 2)
    mixed = [0.3 * a - 1.7 * b for a, b in zip(one, two, strict=True)]
    expected = 0.3 * np.array(stepped(settings, one)) - 1.7 * np.array(stepped(settings, two))
    scale = np.abs(law_block(settings, ARM, PERIOD_S, 0.03)) @ (np.abs(one) + np.abs(two))
    assert np.all(np.abs(expected - stepped(settings, mixed)) <= 1e-12 * scale)


def test_the_law_is_not_linear_beyond_its_boundary_layer() -> None:
    settings = law_settings(K_S=1.0, delta=1e-3)
    matrix = law_block(settings, ARM, PERIOD_S, 0.03)
    fed = [1.0] + [0.0] * (matrix.shape[1] - 1)
    assert abs((matrix @ fed)[0]) > 2.0 * abs(stepped(settings, fed)[0])


@pytest.mark.parametrize("observer", OBSERVERS)
def test_the_matrix_of_an_observer_reproduces_its_steps(observer: ForceObserver) -> None:
    matrix = observer_block(observer)
    for seed in range(5):
        fed = drawn(matrix.shape[1], seed)
        after, force_mN = with_state(observer, tuple(fed[3:])).observe(fed[0], fed[1], fed[2])
        scale = np.abs(matrix) @ np.abs(fed)
        found = [force_mN, *state_of(after)]
        assert np.all(np.abs(matrix @ fed - found) <= 1e-12 * scale)


def test_a_state_is_flattened_and_rebuilt() -> None:
    law = control_law.build(law_settings(), ARM, PERIOD_S, 0.03)
    state = control_law.start(law, x_um=1.5, x_r_um=1.0, force_mN=2.0, applied_V=0.1)
    values = flatten(state)
    assert refill(state, iter(values)) == state
    assert flatten(refill(state, iter(range_of(values)))) == range_of(values)


def range_of(values: list[float]) -> list[float]:
    return [float(index) for index in range(len(values))]


def test_a_state_without_floats_is_refused() -> None:
    with pytest.raises(TypeError, match="made of floats, not of int"):
        flatten(Counted())


def test_a_matrix_that_is_shared_cannot_be_changed() -> None:
    matrix = law_block(law_settings(), ARM, PERIOD_S, 0.03)
    with pytest.raises(ValueError, match="read-only"):
        matrix[0, 0] = 1.0
