"""A kink in the path of an arm whose force is known: caused by the sensor's noise, or by a part."""

from functools import cache
from math import copysign

import numpy as np
import pytest
from msgspec.structs import replace

from pincette_estimator.config import EstimatorConfig, configure
from pincette_estimator.state import NOT_TOUCHED, SURE
from pincette_estimator.step import State
from tests.unit.estimator.bench import TAUGHT, Bench, a_rig

CONFIG, LINEAR = configure(a_rig(TAUGHT)), configure(a_rig(None))
S_P, K_E = CONFIG.arms[0].compliance_um_per_mN, 2.17
TOUCH_MN, SAMPLES = 2.0, 3
STEP_V, HIGHEST_V, NOISE_UM = 0.004, 4.0, 0.03
BENT = (155, 442, 854, 1035, 1502)
"""Seeds of noise that bends the path of a free arm as a part does, from some 4000 that were
tried."""


@cache
def followed() -> tuple[State, int]:
    """Return an estimator that has tracked x_1 over the range, is armed again, and zeroed."""
    bench = Bench(CONFIG)
    for voltage_V in (*np.arange(0.0, HIGHEST_V, 0.02), *np.arange(HIGHEST_V, 0.0, -0.02)):
        free_um = bench.state.arms[0].response.updated(float(voltage_V), 0.02).position_um()
        bench.feed(free_um, float(voltage_V))
    bench.arm(2)
    for zero in (*12 * [False], True):
        bench.feed(bench.state.arms[0].response.updated(0.0, 0.02).position_um(), 0.0, zero=zero)
    return bench.state, bench.seq


def touched_with_mN(
    seed: int, contact_um: float = 1e9, K_e: float = K_E, gain: float = 1.0
) -> float | None:
    """Return the true force when a guard detects contact; None if it never does.

    ``gain``: displacement of the arm divided by that of its model.
    """
    bench = Bench(CONFIG)
    (bench.state, bench.seq), bench.epoch, count = followed(), 2, 0
    noises_um = np.random.default_rng(seed).normal(0.0, NOISE_UM, round(HIGHEST_V / STEP_V))
    from_um = bench.state.arms[0].response.position_um()
    for tick, noise_um in enumerate(noises_um.tolist(), start=1):
        voltage_V = STEP_V * tick
        model_um = bench.state.arms[0].response.updated(voltage_V, 0.02).position_um()
        free_um = from_um + gain * (model_um - from_um)
        pressed_um = max(0.0, free_um - contact_um) * S_P * K_e / (1.0 + S_P * K_e)
        estimate = bench.feed(free_um - pressed_um + noise_um, voltage_V)
        count = count + 1 if abs(estimate.arms[0].touch_mN or 0.0) >= TOUCH_MN else 0
        if count == SAMPLES:
            return pressed_um / S_P
    return None


@pytest.mark.parametrize("seed", BENT)
def test_a_kink_caused_by_noise_on_a_free_arm_is_not_reported_as_a_touch(seed: int) -> None:
    assert touched_with_mN(seed) is None


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("K_e", [0.7 * K_E, 1.3 * K_E])
@pytest.mark.parametrize("gain", [0.98, 1.0, 1.02])
def test_a_part_is_still_detected_by_its_kink(seed: int, K_e: float, gain: float) -> None:
    """This also holds if the force has an error up to 1.4 mN, as from a model that is wrong by 2
    %."""
    felt_mN = touched_with_mN(seed, contact_um=33.0, K_e=K_e, gain=gain)
    print(seed, K_e, gain, felt_mN)
    assert felt_mN is not None
    assert 0.5 < felt_mN < 5.0


@pytest.mark.parametrize(("force_mN", "multiple"), [(6.0, NOT_TOUCHED), (-6.0, SURE)])
def test_after_a_zero_a_force_beyond_its_uncertainty_is_reported_as_a_touch(
    force_mN: float, multiple: float
) -> None:
    """A part that pressed at rest causes no kink, and is found only by its force."""
    bench = Bench(CONFIG)
    (bench.state, bench.seq), bench.epoch = followed(), 2
    confirmed = replace(bench.state.arms[0], zero_confirmed=True)
    bench.state = replace(bench.state, arms=(confirmed,))
    free_um = confirmed.response.updated(0.0, 0.02).position_um()
    (estimate,) = bench.feed(free_um - S_P * force_mN, 0.0).arms
    sure_mN = 6.0 - multiple * estimate.force_uncertainty_mN
    assert estimate.touch_mN == pytest.approx(copysign(sure_mN, force_mN))


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("config", [LINEAR, CONFIG])
def test_a_part_that_pressed_the_arm_at_the_start_is_found_on_the_way_up(
    config: EstimatorConfig, held: bool
) -> None:
    """The initial position of the arm is not known to be free.

    With a model in use a part that no job held was pressed up to the limit of the force.
    """
    bench, contact_um, kappa = Bench(config), -8.0, S_P * K_E
    voltages_V = (*np.arange(0.0, -1.0, -0.01), *np.arange(-1.0, 2.0, 0.01))
    for tick, voltage_V in enumerate(voltages_V):
        response = bench.state.arms[0].response.updated(float(voltage_V), 0.02)
        free_um = response.displacement_um() if response.remembers else 19.0 * float(voltage_V)
        pressed_um = max(0.0, free_um - contact_um) * kappa / (1.0 + kappa)
        estimate = bench.feed(free_um - pressed_um, float(voltage_V), held=held and tick < 5)
        if tick > 100 and (estimate.arms[0].touch_mN or 0.0) >= TOUCH_MN:
            assert 1.0 < pressed_um / S_P < 6.0
            assert estimate.arms[0].touch_x_um == pytest.approx(contact_um, abs=1.5)
            return
    pytest.fail("no touch is seen")
