"""Compliance by weights: drift and creep between the steps, and the stated uncertainty."""

from collections.abc import Sequence

import numpy as np
import pytest

from pincette.control.calibration.weights import WeighedCompliance, weighed_compliance
from pincette.control.planning.calibration_programs import there_and_back

S_P = 0.46
WEIGHTS_MN = (0.0, 5.0, 10.0, 20.0)
NOISE_UM = 0.05


def weighed(seed: int, steps: Sequence[float] = there_and_back(WEIGHTS_MN)) -> WeighedCompliance:
    """Return means of a second under weights that a person hangs at irregular times, with drift."""
    chance = np.random.default_rng(seed)
    t = np.cumsum(chance.uniform(6.0, 20.0, len(steps)))
    drift = float(chance.uniform(-0.01, 0.01))
    slow = 0.05 * np.sin(2.0 * np.pi * t / 300.0 + float(chance.uniform(0.0, 6.28)))
    x = 3.0 - S_P * np.array(steps) + drift * t + slow
    mean = NOISE_UM / 50**0.5
    x += chance.normal(0.0, mean, len(steps))
    return weighed_compliance(list(steps), x.tolist(), t.tolist(), noise_um=mean)


def test_weights_increase_and_decrease_again() -> None:
    assert there_and_back((0.0, 5.0, 10.0)) == (0.0, 5.0, 10.0, 5.0, 0.0)


def test_the_compliance_of_twenty_rigs_is_found() -> None:
    errors = [100.0 * (weighed(seed).compliance_um_per_mN / S_P - 1.0) for seed in range(20)]
    print("errors in %:", " ".join(f"{error:.2f}" for error in errors))
    assert max(abs(error) for error in errors) < 1.0


def test_weights_that_only_increase_mistake_slow_drift_for_compliance() -> None:
    both, one = list[float](), list[float]()
    for seed in range(100):
        both.append(weighed(seed).compliance_um_per_mN - S_P)
        one.append(weighed(seed, (*WEIGHTS_MN, 25.0)).compliance_um_per_mN - S_P)
    assert float(np.std(both)) < 0.5 * float(np.std(one))


def test_the_stated_uncertainty_equals_the_spread_of_many_weighings() -> None:
    chance = np.random.default_rng(2)
    steps = there_and_back(WEIGHTS_MN)
    t = np.arange(len(steps)) * 10.0
    found = [
        weighed_compliance(
            steps,
            (3.0 - S_P * np.array(steps) + chance.normal(0.0, 0.02, len(steps))).tolist(),
            t.tolist(),
        )
        for _ in range(400)
    ]
    values = [each.compliance_um_per_mN for each in found]
    # The mean of the squares is unbiased, with four degrees of freedom.
    stated = float(np.mean([each.uncertainty_um_per_mN**2 for each in found])) ** 0.5
    assert stated == pytest.approx(float(np.std(values)), rel=0.1)
    assert float(np.mean(values)) == pytest.approx(S_P, rel=1e-3)


def test_the_uncertainty_of_the_weights_is_added() -> None:
    steps = there_and_back((0.0, 10.0))
    exact = [3.0 - S_P * weight for weight in steps]
    with pytest.raises(ValueError, match="3 steps with weights, must be at least 4"):
        weighed_compliance(steps, exact, [0.0, 1.0, 2.0])
    steps = there_and_back((0.0, 10.0, 20.0))
    exact = [3.0 - S_P * weight for weight in steps]
    found = weighed_compliance(steps, exact, [0.0, 1.0, 2.0, 3.0, 4.0], weight_uncertainty=0.02)
    assert found.uncertainty_um_per_mN == pytest.approx(0.02 * S_P)
    assert found.sag_um.tolist() == pytest.approx([S_P * weight for weight in steps])
    assert found.rest_um == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("weights", "text"),
    [
        ((0.0,), "must be 0 mN and at least one more"),
        ((1.0, 2.0), "must be 0 mN and at least one more"),
        ((0.0, 5.0, 5.0), "weight 5.0 mN after 5.0 mN: must be larger"),
        ((0.0, float("nan")), "must be larger"),
    ],
)
def test_weights_that_do_not_increase_from_zero_are_refused(
    weights: tuple[float, ...], text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        there_and_back(weights)


def test_uninformative_weighings_are_refused() -> None:
    with pytest.raises(ValueError, match="hang them up and down again"):
        weighed_compliance([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match=r"compliance = -0\.3999"):
        weighed_compliance([0.0, 1.0, 2.0, 1.0], [0.0, 0.4, 0.8, 0.4], [0.0, 1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="not finite"):
        weighed_compliance(
            [0.0, 1.0, 2.0, 1.0], [0.0, float("inf"), 0.8, 0.4], [0.0, 1.0, 2.0, 3.0]
        )


@pytest.mark.parametrize("leaves_at_mN", [2.0, 4.0, 8.0])
def test_an_arm_supported_by_a_part_is_refused(leaves_at_mN: float) -> None:
    """Until the weight has lifted it off, a part of 2.17 mN/µm supports it too."""
    F = np.array(there_and_back(WEIGHTS_MN))
    free_um, borne_mN = -S_P * F, np.minimum(F, leaves_at_mN)
    x_um = free_um + S_P * borne_mN * (1.0 - 1.0 / (1.0 + S_P * 2.17))
    times_s = [2.5 * step for step in range(len(F))]
    weighed_compliance(F.tolist(), free_um.tolist(), times_s, noise_um=0.005)
    with pytest.raises(ValueError, match=r"bends by 0\.\d+ µm/mN up to 5 mN .* a part at"):
        weighed_compliance(F.tolist(), x_um.tolist(), times_s, noise_um=0.005)
