"""Which loops may run, which may not, and whether the advice is right."""

import re
from dataclasses import replace
from math import inf

import pytest

from pincette.control.arm.plant import consistent_arm
from pincette.control.force.inverse_dynamics import inverse_dynamics
from pincette.control.laws.definition import LawSettings
from pincette.control.stability.assessment import assess
from pincette.control.stability.limits import limit_radius_at
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.worst_case import Intervals, around
from tests.support.laws import default_settings, law_settings
from tests.unit.control.force.exact_arm import OMEGA_N, S_P, ZETA

ARM = consistent_arm(OMEGA_N, ZETA, 19.0, S_P)
PART = around(2.17, 0.3)
DEFAULT = Loop(law_settings(), ARM, 0.02, force_filter_s=0.03)


@pytest.mark.parametrize(
    "law",
    [
        law_settings(),
        law_settings(K_P=5.0),
        law_settings(K_P=0.5),
        law_settings("dsmifc", K_P=2.0, delta=1e6),
        default_settings("pbsmic", "printed"),
        default_settings("dsmifc", "printed"),
    ],
)
def test_the_laws_are_admitted_at_the_period_of_the_paper(law: LawSettings) -> None:
    found = assess(replace(DEFAULT, law=law), PART)
    assert found.stable
    assert found.reason == ""
    assert found.limit_radius == 0.97
    assert 0.7 < found.radius < 0.9
    assert found.radius ** (found.settling_s / 0.02) == pytest.approx(0.02)


def test_a_refusal_names_spectral_radius_limit_worst_case_and_remedy() -> None:
    found = assess(replace(DEFAULT, period_s=0.005), PART)
    assert not found.stable
    assert found.radius > found.limit_radius
    assert found.settling_s == inf
    omega_n = OMEGA_N * found.case.frequency_factor
    for part in (
        f"the loop is unstable: spectral radius {found.radius:.4g}, limit {found.limit_radius:.4g}",
        "at a period of 5 ms",
        "free, ω_n" if found.case.K_e_mN_per_um == 0.0 else "in contact with K_e = ",
        f"ω_n = {omega_n:.0f} rad/s",
        f"delay = {5.0 * found.case.delay_periods:.2g} ms",
    ):
        assert part in found.reason


def proposed(loop: Loop, text: str) -> tuple[Loop, str]:
    """Return the loop that a proposal requests, and its predicted radius."""
    match = re.fullmatch(r"(.+) gives ([0-9.]+)", text)
    assert match is not None, text
    for change in match[1].split(" and "):
        if change == "an RC of 3.3 ms before the amplifier":
            loop = replace(loop, output_lag_s=0.0033)
        elif change.startswith("a period of "):
            loop = replace(loop, period_s=1e-3 * float(change.split()[3]))
        else:
            name, value = change.split(" = ")
            loop = loop.with_gains(**{name: float(value)})
    return loop, match[2]


@pytest.mark.parametrize(
    ("law", "period_s"),
    [
        (law_settings(), 0.005),
        (law_settings(), 0.001),
        (law_settings(K_P=5.0), 0.004),
        (law_settings(K_P=50.0), 0.02),
        (law_settings(K_S=1.0, delta=1.0), 0.02),
        (law_settings(K_S=1.0, delta=1.0), 0.005),
        (default_settings("dsmifc", "printed"), 0.005),
    ],
)
def test_gains_that_a_refusal_proposes_are_stable(law: LawSettings, period_s: float) -> None:
    loop = replace(DEFAULT, law=law, period_s=period_s)
    found = assess(loop, PART)
    assert not found.stable
    advice = found.reason.split("; ")[1].split(", ")
    assert len(advice) in (1, 2)
    for text in advice:
        other, promised = proposed(loop, text)
        reached = assess(other, PART)
        assert reached.stable, text
        assert f"{reached.radius:.3f}" == promised, text


def test_a_loop_without_a_remedy_is_reported() -> None:
    found = assess(replace(DEFAULT, law=law_settings(K_P=0.01), period_s=0.001), PART)
    assert "; no single change of a gain or the period that was tried is sufficient" in found.reason


def test_a_switching_term_without_effect_is_not_named_as_the_cause() -> None:
    loop = Loop(default_settings("pbsmic", "printed"), ARM, 0.004)
    assert "K_S" not in assess(loop, PART).reason


def test_an_observer_is_not_reused_for_another_period() -> None:
    observer = inverse_dynamics(OMEGA_N, ZETA, S_P, period_s=0.004, filter_s=1e-3)
    loop = Loop(law_settings(K_P=5.0), ARM, 0.004, 0.03, observer=observer)
    assert "a period of 4 ms" in assess(loop, PART).reason
    assert "a period of 5 ms" not in assess(loop, PART).reason


def test_the_refusal_of_a_slow_loop_states_that_it_settles_too_slowly() -> None:
    found = assess(replace(DEFAULT, law=law_settings(K_P=50.0)), PART)
    assert found.reason.startswith("the loop settles too slowly: spectral radius 0.98")
    assert 2.6 < found.settling_s < 10.0


def test_a_loop_at_the_limit_of_the_spectral_radius_is_not_stable() -> None:
    found = assess(DEFAULT, PART)
    assert found.stable
    assert not replace(found, radius=found.limit_radius).stable


def test_a_longer_delay_worsens_the_radius() -> None:
    """A loop for a short delay does not fit a delay of nearly a period."""
    loop = Loop(law_settings(), ARM, 0.008, force_filter_s=0.03)
    at_once = assess(loop, around(2.17, 0.3, delay_periods=(0.0, 0.0)))
    late = assess(loop, around(2.17, 0.3, delay_periods=(0.0, 1.0)))
    assert at_once.stable
    assert late.radius > at_once.radius + 0.05
    assert late.case.delay_periods > 0.5


def test_an_assessment_is_reproducible() -> None:
    loop = replace(DEFAULT, period_s=0.015)
    assert assess(loop, PART) == assess(replace(loop), Intervals(PART.K_e_mN_per_um))
    assert assess(loop, PART).limit_radius == limit_radius_at(0.015)
