"""Peak force of a load if the part is softer or harder than planned, on the demo rig."""

from collections.abc import Iterator
from math import exp, log

import numpy as np
import pytest

from tests.support.slips import played

PROFILES = ("gentle", "quick")
PLANNED_MN_PER_UM = 2.17
MOST = 1.05
"""Largest true force over the planned one at noise up to 0.05 µm, from 10 mN on, if the part is
0.5 to 2 times as stiff as planned. At 5 mN the estimator's own error is 6 to 9 %."""
RARE, LARGEST = 0.05, {0.02: 1.05, 0.05: 1.07, 0.15: 1.2}
"""Share of draws that may exceed ``MOST``, and the largest peak of all, by the noise in µm."""


def peak(
    profile: str, share: float, seed: int = 1, noise_um: float = 0.03, **wishes: float
) -> float:
    """Return the peak of the true force of a grip or, without a profile, of a track."""
    simulation = {
        "environment_stiffness_mN_per_um": PLANNED_MN_PER_UM * share,
        "seed": seed,
        "sensor_noise_um": noise_um,
    }
    job = played(
        simulation, {"sensor": {"noise_um": noise_um}}, profile=profile, hold_s=0.5, **wishes
    )
    print(f"{profile} {share:.2f} {seed} {wishes}: {job.outcome}, peak {job.peak_mN:.2f} mN")
    return job.peak_mN


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("share", [0.5, 2.0])
def test_a_load_does_not_exceed_the_plan(profile: str, share: float) -> None:
    assert peak(profile, share, force_mN=10.0) <= MOST * 10.0


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_the_load_of_a_track_does_not_exceed_its_highest_force(share: float) -> None:
    simulation = {"environment_stiffness_mN_per_um": PLANNED_MN_PER_UM * share}
    job = played(
        simulation,
        kind="track",
        shape="sinusoid",
        force_mean_mN=10.0,
        force_pp_mN=8.0,
        cycles=1,
    )
    assert job.peak_mN <= MOST * 14.0


def drawn(count: int, seed: int) -> Iterator[tuple[float, int, float]]:
    """Draw stiffness over the planned one, a seed of the rig, and a force."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        share = exp(rng.uniform(log(0.5), log(2.0)))
        yield share, int(rng.integers(1000, 9999)), float(rng.uniform(10.0, 25.0))


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("noise_um", LARGEST)
def test_over_draws_of_stiffness_and_force_few_peaks_exceed_the_plan(
    profile: str, noise_um: float
) -> None:
    """At 0.15 µm most zeros are refused, and those grips press nothing."""
    peaks = [
        peak(profile, share, seed, noise_um, force_mN=force_mN) / force_mN
        for share, seed, force_mN in drawn(24, 7302)
    ]
    assert max(peaks) <= LARGEST[noise_um]
    if noise_um < 0.1:
        assert np.mean(np.array(peaks) > MOST) <= RARE
