"""The assessment of two arms: its matrix compared with the loop itself, and its refusals."""

from dataclasses import replace

import numpy as np
import pytest

from pincette.control.arm.plant import OutputTiming, consistent_arm
from pincette.control.force.observers import QuasiStatic, QuasiStaticParameters
from pincette.control.laws import two_arms
from pincette.control.laws.two_arms import Pair, TwoArmReferences
from pincette.control.stability.two_arms import (
    PLACES,
    TwoArmCase,
    TwoArmLoop,
    assess_two_arms,
    law_matrix,
    loop_matrices,
    sampled_pair,
)

OMEGA_N = 2437.8
ARMS = (
    consistent_arm(OMEGA_N, 0.026, 19.0, 0.46),
    consistent_arm(0.97 * OMEGA_N, 0.026, 18.0, 0.48),
)
SLOW, FAST = OutputTiming(0.005, 0.0033), OutputTiming(0.00065, 0.0)


def _loop(period_s: float, output: OutputTiming, **gains: float) -> TwoArmLoop:
    values = two_arms.default_gains(OMEGA_N, period_s) | gains
    return TwoArmLoop(ARMS, tuple(values.items()), period_s, 0.025, output)


SLOW_LOOP, FAST_LOOP = _loop(0.02, SLOW), _loop(0.001, FAST)


@pytest.mark.parametrize("loop", [SLOW_LOOP, FAST_LOOP], ids=["20 ms", "1 ms"])
def test_the_default_gains_are_admitted(loop: TwoArmLoop) -> None:
    found = assess_two_arms(loop)
    assert found.reason == ""
    assert found.radius < found.limit_radius
    assert found.uninformed_radius < found.limit_uninformed_radius


@pytest.mark.parametrize(
    ("loop", "said"),
    [
        (_loop(0.001, FAST, f_q=100.0), "too near to instability"),
        (_loop(0.001, FAST, n=1.0, f_q=30.0), "is unstable"),
        (_loop(0.001, FAST, f_F=60.0), "until a touch or a loss"),
        (_loop(0.02, SLOW, f_q=0.1), "settles too slowly"),
    ],
    ids=["near", "unstable", "uninformed", "slow"],
)
def test_unstable_gains_are_refused_with_value_limit_and_remedy(
    loop: TwoArmLoop, said: str
) -> None:
    reason = assess_two_arms(loop).reason
    assert said in reason
    assert "limit" in reason
    assert "f_q" in reason


@pytest.mark.parametrize("pressed", [True, False])
@pytest.mark.parametrize("loop", [SLOW_LOOP, FAST_LOOP], ids=["20 ms", "1 ms"])
def test_the_matrix_of_the_law_agrees_with_law_and_estimators(
    loop: TwoArmLoop, pressed: bool
) -> None:
    """Over several ticks, with the estimators as they run, and any inputs."""
    made = two_arms.build(ARMS, dict(loop.gains), loop.period_s, 0.025, loop.output)
    observers = [
        QuasiStatic(QuasiStaticParameters(s, older=made.older, lag=made.lag_kept))
        for s in made.compliances_um_per_mN
    ]
    references = TwoArmReferences(place_um=0.0, pressed=pressed)
    state, matrix = two_arms.start(), law_matrix(loop, pressed=pressed)
    chance = np.random.default_rng(11)
    before = np.zeros(matrix.shape[1] - 4)
    # The first tick initialises the states; from tick 0 on both agree.
    for number in range(12):
        inputs = chance.normal(size=4) if number else np.zeros(4)
        x_1, x_2, free_1, free_2 = map(float, inputs)
        tips: Pair = (x_1, x_2)
        forces: list[float] = []
        for arm, free_um in enumerate((free_1, free_2)):
            if not number:
                observers[arm] = observers[arm].restart(0.0, 0.0, 0.0)
            observers[arm], force_mN = observers[arm].observe(tips[arm], free_um, 0.0)
            forces.append(force_mN)
        state, output = two_arms.step(
            made,
            state,
            tips_um=tips,
            free_um=(free_1, free_2),
            forces_mN=(forces[0], forces[1]),
            references=references,
        )
        found = matrix @ np.concatenate([inputs, before])
        assert found[:2] == pytest.approx(output.free_um, abs=1e-9)
        before = found[2:]


def test_held_arms_oscillate_together_and_free_arms_each_alone() -> None:
    cases = tuple(TwoArmCase(contact, False) for contact in ("held", "free"))
    transition, _ = sampled_pair(FAST_LOOP, cases)
    rates = np.log(np.linalg.eigvals(transition[:, :4, :4]).astype(np.complex128))
    held, free = np.sort(np.abs(np.imag(rates)), axis=1) / FAST_LOOP.period_s
    first, second = ARMS
    swing = ((first.k + second.k) / (first.m + second.m)) ** 0.5
    # The other mode of a held pair lies above half the rate, and is tested elsewhere.
    assert np.min(np.abs(held - swing)) < 2e-3 * swing
    assert free[::2] == pytest.approx([0.97 * OMEGA_N, OMEGA_N], rel=2e-3)


def test_two_arms_without_their_part_diverge_if_their_slope_is_above_the_identified_one() -> None:
    right = TwoArmCase("free", True)
    steep = replace(right, gain_factors=(1.2, 1.2))
    matrices = loop_matrices(SLOW_LOOP, (right, steep))
    radii = np.max(np.abs(np.linalg.eigvals(matrices)), axis=1)
    assert radii[0] == pytest.approx(1.0, abs=1e-6)
    assert radii[1] > 1.03
    assert matrices.shape[1] > PLACES
