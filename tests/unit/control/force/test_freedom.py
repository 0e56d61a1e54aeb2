"""The share of the free motion that an arm makes, and the verdict that follows."""

import numpy as np
import pytest

from pincette.control.force.freedom import FreeArm, Freedom, FreedomFit

ARM = FreeArm(0.46, 1.0 / (1.0 + 0.46 * 1.5), 0.02, 0.03)


def fitted(share: float, *, noise_um: float = 0.03, drift_um_per_s: float = 0.0) -> Freedom:
    """Fit a motion of 2 µm there and back, with noise and creep."""
    chance, fit = np.random.default_rng(7), FreedomFit()
    for tick in range(75):
        free_um = 20.0 - min(tick, 75 - tick) / 37.5 * 2.0
        t_s = 0.02 * tick
        x_um = 5.0 + share * free_um + drift_um_per_s * t_s + float(chance.normal(0.0, noise_um))
        fit = fit.add(ARM, t_s, x_um, (free_um - x_um) / ARM.compliance_um_per_mN)
    found = fit.freedom(ARM, drifts=True)
    assert found is not None
    return found


@pytest.mark.parametrize("share", [1.0, 0.97, 0.5, 0.1])
def test_the_freedom_of_the_part_is_found_despite_noise_and_drift(share: float) -> None:
    found = fitted(share, drift_um_per_s=0.3)
    assert found.share == pytest.approx(share, abs=found.uncertainty)
    assert found.uncertainty < 0.06


@pytest.mark.parametrize(
    ("share", "uncertainty", "verdict"),
    [
        (1.0, 0.05, "released"),
        (0.97, 0.05, "released"),
        (0.5, 0.05, "sticks"),
        (0.8, 0.5, "unknown"),
        (0.8, 0.05, "unknown"),
        (1.2, 0.05, "unknown"),
    ],
)
def test_free_or_held_is_reported_only_if_the_other_is_excluded(
    share: float, uncertainty: float, verdict: str
) -> None:
    assert Freedom(share, uncertainty).verdict(ARM) == verdict


def test_the_stated_stiffness_of_the_part_is_bounded() -> None:
    stiffness, uncertainty = Freedom(0.5, 0.05).stiffness(ARM)
    assert stiffness == pytest.approx(1.0 / 0.46)
    assert uncertainty == pytest.approx(0.2 / 0.46)
    assert Freedom(-0.1, 0.05).stiffness(ARM)[0] == pytest.approx(49.0 / 0.46)


def test_too_few_samples_or_no_motion_give_no_result() -> None:
    fit = FreedomFit()
    for tick in range(20):
        fit = fit.add(ARM, 0.02 * tick, 5.0, 0.0)
        assert fit.freedom(ARM, drifts=True) is None


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ((0.0, 0.5, 0.02, 0.03), "compliance = 0.0 µm/mN"),
        ((0.46, -0.5, 0.02, 0.03), "share of a held arm = -0.5"),
        ((0.46, 0.5, -0.02, 0.03), "error of the share"),
        ((0.46, 0.5, 0.02, float("nan")), "noise"),
    ],
)
def test_impossible_numbers_are_refused(
    numbers: tuple[float, float, float, float], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        FreeArm(*numbers)
