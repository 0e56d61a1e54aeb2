"""The search for the worst case compared with a random search of more points."""

import re

import numpy as np
import pytest

from pincette.control.arm.plant import consistent_arm
from pincette.control.arm.sampled_arm import LoopCase
from pincette.control.laws.definition import LawSettings
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.loop_modes import counted_radii
from pincette.control.stability.worst_case import Intervals, around, worst_case
from tests.support.laws import default_settings, law_settings
from tests.unit.control.force.exact_arm import OMEGA_N, S_P, ZETA

from .radii import spectral_radii

ARM = consistent_arm(OMEGA_N, ZETA, 19.0, S_P)
PART = around(2.17, 0.3)
LIMIT = 0.97


def drawn(count: int, seed: int) -> tuple[LoopCase, ...]:
    """Draw cases anywhere within the intervals of PART, a third of them free."""
    numbers = np.random.default_rng(seed)
    return tuple(
        LoopCase(
            0.0 if index % 3 == 0 else float(numbers.uniform(0.7 * 2.17, 1.3 * 2.17)),
            float(numbers.uniform(0.95, 1.05)),
            float(numbers.uniform(0.0, 0.5)),
        )
        for index in range(count)
    )


@pytest.mark.parametrize("period_s", [0.02, 0.01, 0.005, 0.001])
@pytest.mark.parametrize(
    "law",
    [
        law_settings(),
        law_settings(K_P=0.5, force_age="newest"),
        default_settings("pbsmic", "printed"),
        law_settings("dsmifc", K_P=2.0, delta=1e6),
    ],
)
def test_a_random_search_finds_no_worse_case(law: LawSettings, period_s: float) -> None:
    loop = Loop(law, ARM, period_s, force_filter_s=0.03)
    case, radius = worst_case(loop, PART, LIMIT)
    blind = np.max(counted_radii(loop, drawn(3000, seed=7), LIMIT))
    assert radius > blind - 0.01
    assert radius == pytest.approx(counted_radii(loop, (case,), LIMIT)[0], rel=1e-12)


def test_the_worst_case_found_is_within_the_intervals() -> None:
    case, _ = worst_case(Loop(law_settings(), ARM, 0.005, force_filter_s=0.03), PART, LIMIT)
    assert case.K_e_mN_per_um == 0.0 or 0.7 * 2.17 <= case.K_e_mN_per_um <= 1.3 * 2.17
    assert 0.95 <= case.frequency_factor <= 1.05
    assert 0.0 <= case.delay_periods <= 0.5


def test_a_resonance_error_of_five_percent_changes_the_verdict() -> None:
    """At 5 ms the default law passes as identified, and fails nearby."""
    loop = Loop(law_settings(), ARM, 0.005, force_filter_s=0.03)
    assert np.max(spectral_radii(loop, PART.middle())) < LIMIT
    case, radius = worst_case(loop, PART, LIMIT)
    assert radius > 1.05
    assert case.K_e_mN_per_um > 0.0


@pytest.mark.parametrize("force_gain", np.linspace(0.0, 15000.0, 9).tolist())
def test_a_shortened_search_refuses_the_same_loops(force_gain: float) -> None:
    loop = Loop(law_settings("dsmifc", K_f=force_gain, delta=1e6), ARM, 0.02, force_filter_s=0.03)
    case, radius = worst_case(loop, PART, LIMIT, enough=LIMIT)
    whole, worst = worst_case(loop, PART, LIMIT)
    assert (radius >= LIMIT) == (worst >= LIMIT)
    assert radius == pytest.approx(counted_radii(loop, (case,), LIMIT)[0], rel=1e-12)
    assert radius <= worst
    if worst < LIMIT:
        assert (case, radius) == (whole, worst)


def test_intervals_without_width_contain_a_single_case() -> None:
    loop = Loop(law_settings(), ARM, 0.01, force_filter_s=0.03)
    point = Intervals((2.0, 2.0), False, (1.01, 1.01), (0.2, 0.2))
    case = LoopCase(2.0, 1.01, 0.2)
    assert point.middle() == (case,)
    assert worst_case(loop, point, LIMIT) == (case, spectral_radii(loop, (case,))[0])


def test_a_wider_interval_does_not_lower_the_worst_radius() -> None:
    loop = Loop(law_settings(), ARM, 0.005, force_filter_s=0.03)
    radii = [worst_case(loop, around(2.17, share), LIMIT)[1] for share in (0.0, 0.1, 0.3)]
    assert radii[0] <= radii[1] + 0.01
    assert radii[1] <= radii[2] + 0.01


def test_a_worst_case_is_found_without_any_contact() -> None:
    loop = Loop(law_settings(), ARM, 0.004, force_filter_s=0.03)
    case, radius = worst_case(loop, Intervals(None), LIMIT)
    assert case.K_e_mN_per_um == 0.0
    assert radius > 1.0


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((None, False), "neither free nor in contact"),
        (((3.0, 2.0),), "K_e_mN_per_um: from 3.0 to 2.0, must be ascending"),
        (((-1.0, 2.0),), "contact stiffness K_e = -1.0 mN/µm"),
        (((1.0, 2.0), True, (0.0, 1.0)), "frequency factor = 0.0"),
        (((1.0, 2.0), True, (1.0, 1.0), (0.0, 1.5)), "delay = 1.5 periods"),
    ],
)
def test_impossible_intervals_are_refused(
    values: tuple[tuple[float, float] | None, bool], text: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(text)):
        Intervals(*values)


def test_a_response_steeper_than_its_model_is_assessed_at_its_greatest_slope() -> None:
    """Without contact the law's gain is the slope: the free arm is the faster to ring by it."""
    loop = Loop(law_settings(K_P=0.1, K_f=2000.0), ARM, 0.02, force_filter_s=0.03)
    known = Intervals((2.0, 2.4))
    vague = Intervals((2.0, 2.4), gain_factor=(0.7, 1.2))
    _, radius = worst_case(loop, known, LIMIT)
    case, wider = worst_case(loop, vague, LIMIT)
    assert wider > radius
    assert case.gain_factor in (0.7, 1.2)


def test_without_uncertainty_there_is_one_case() -> None:
    loop = Loop(law_settings(), ARM, 0.02, force_filter_s=0.03)
    exact = Intervals(None, frequency_factor=(1.0, 1.0), delay_periods=(0.3, 0.3))
    case, _ = worst_case(loop, exact, LIMIT)
    assert (case.K_e_mN_per_um, case.delay_periods, case.gain_factor) == (0.0, 0.3, 1.0)


def test_a_law_of_the_identified_set_has_the_spectral_radius_of_the_consistent_set() -> None:
    case = LoopCase(2.0, gain_factor=0.8)
    radii = [
        counted_radii(Loop(law_settings(set=name, K_f=2000.0), ARM, 0.02), (case,), LIMIT)[0]
        for name in ("consistent", "identified")
    ]
    assert radii[0] == radii[1]
