"""Parameters of a law, and the force that is used as F_k."""

from math import exp, inf, nan
from typing import Any

import pytest
from msgspec.structs import replace

from pincette.control.laws.law import build, rebase, start, step
from pincette.control.laws.parameters import ParameterSet
from pincette.control.laws.sliding import SlidingParameters
from tests.support.laws import default_settings, law_settings, step_at

from .model_loop import ARM, SCHEMES, Loop, law_of, resting_arm

BOTH = pytest.mark.parametrize("scheme", SCHEMES)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("K_P", -0.1, "K_P = -0.1, must be finite and at least 0"),
        ("K_I", 0.0, "K_I = 0.0, must be finite and above 0"),
        ("K_S", -1.0, "K_S = -1.0 mN, must be finite and at least 0"),
        ("delta", 0.0, "delta = 0.0 µm, must be finite and above 0"),
        ("M", -1.0, "M = -1.0 mN·s²/µm, must be finite and at least 0"),
        ("B", inf, "B = inf mN·s/µm, must be finite and at least 0"),
        ("K", 0.0, "K = 0.0 mN/µm, must be finite and above 0"),
        ("K_f", nan, "K_f = nan mN/mN, must be finite and at least 0"),
    ],
)
def test_impossible_settings_are_refused(name: str, value: float, text: str) -> None:
    values: dict[str, Any] = {name: value}
    with pytest.raises(ValueError, match=f"^{text}$"):
        law_settings(**values)


def test_the_boundary_layer_of_dsmifc_is_stated_as_a_force() -> None:
    with pytest.raises(ValueError, match=r"delta = -1\.0 mN, must be"):
        law_settings("dsmifc", delta=-1.0)


@pytest.mark.parametrize("period_s", [0.0, -0.02, nan])
def test_a_law_needs_a_period(period_s: float) -> None:
    with pytest.raises(ValueError, match="period = "):
        build(law_settings(), ARM, period_s, 0.0)


@pytest.mark.parametrize("name", ["M", "B"])
def test_an_impedance_with_overflow_is_refused(name: str) -> None:
    """inf - inf in (16) would not give a voltage."""
    values: dict[str, Any] = {name: 1e308}
    with pytest.raises(ValueError, match="impedance K̄ = inf mN/µm, must be finite"):
        build(law_settings(**values), ARM, 0.02, 0.0)


@pytest.mark.parametrize(
    ("scheme", "name", "gains"),
    [
        # The paper's section VI.D and Fig. 9; Fig. 10 for DSMIFC.
        ("pbsmic", "printed", (1.0, 1.0, 0.003, 100.0)),
        ("dsmifc", "printed", (2.0, 1.0, 1e3, 1e6)),
        ("pbsmic", "consistent", (1.0, 1.0, 0.0, 100.0)),
        ("dsmifc", "consistent", (1.0, 1.0, 0.0, 1e6)),
    ],
)
def test_the_default_gains_are_those_of_the_set(
    scheme: str, name: ParameterSet, gains: tuple[float, ...]
) -> None:
    settings = default_settings(scheme, name)
    assert (
        settings.gains["K_P"],
        settings.gains["K_I"],
        settings.gains["K_S"],
        settings.gains["delta"],
    ) == gains
    assert (settings.scheme, settings.set) == (scheme, name)
    # As printed means with the force as it is measured, at the sample before.
    assert settings.force_age == ("newest" if name == "printed" else "planned")


@BOTH
def test_the_parameter_set_determines_the_arm_model(scheme: str) -> None:
    own = law_of(law_settings(scheme, "consistent")).parameters
    printed = law_of(law_settings(scheme, "printed")).parameters
    assert type(own) is type(printed) is SlidingParameters
    assert own.plant.d_bar == ARM.d
    assert printed.plant.d_bar == 1.129e8
    # k̄ = m/T² + b/T + k with T = 0.02 s.
    assert printed.plant.k_bar == pytest.approx(4.5 + 6340.0 + 5.943e6, abs=1e-6)
    assert own.impedance == printed.impedance


@pytest.mark.parametrize(("filter_s", "share"), [(0.0, 1.0), (0.03, 1.0 - exp(-2.0 / 3.0))])
def test_the_smoothing_factor_of_the_low_pass_filter_is_correct(
    filter_s: float, share: float
) -> None:
    assert law_of(law_settings(), 0.02, filter_s).force == (True, pytest.approx(share, rel=1e-12))
    assert law_of(law_settings(force_age="newest"), 0.02, filter_s).force == (False, 0.0)


@BOTH
def test_the_low_pass_filters_the_force_error_and_not_the_force(scheme: str) -> None:
    """F_r moves and F̂ is 1 mN above it: δ = 1 - (1 - share)^n, and F_k = F_{r,k} + δ."""
    law = law_of(law_settings(scheme, K_P=3.0), 0.02, 0.05)
    share = 1.0 - exp(-0.02 / 0.05)
    state = start(law, x_um=10.0, x_r_um=10.0, force_mN=5.0, applied_V=1.0)
    for tick in range(1, 20):
        before, seen_mN = state, 5.0 + 0.3 * (tick - 1)
        state, _ = step_at(law, state, (10.0, seen_mN + 1.0, 1.0), (10.0, seen_mN + 0.3))
        assert before.force_r_mN == pytest.approx(seen_mN)
        assert state.force_error_mN == pytest.approx(1.0 - (1.0 - share) ** tick, rel=1e-9)
        fed_mN = seen_mN + 0.3 + state.force_error_mN
        assert state.law.history.force_mN == pytest.approx(fed_mN, rel=1e-12)


@BOTH
def test_the_low_pass_starts_at_the_present_error(scheme: str) -> None:
    """2 mN above F_r at the start of the segment: known at once, not after some time constants."""
    law = law_of(law_settings(scheme), 0.02, 0.05)
    state = start(law, x_um=10.0, x_r_um=10.0, force_mN=0.0, applied_V=1.0)
    state = rebase(law, state, x_um=10.0, x_r_um=10.0, force_mN=5.0, force_r_mN=3.0)
    state, _ = step_at(law, state, (10.0, 5.0, 1.0), (10.0, 3.0))
    assert state.force_error_mN == pytest.approx(2.0)
    assert state.law.history.force_mN == pytest.approx(5.0)


@BOTH
def test_the_newest_force_is_used_unfiltered(scheme: str) -> None:
    law = law_of(law_settings(scheme, force_age="newest"), 0.02, 0.05)
    state = start(law, x_um=10.0, x_r_um=10.0, force_mN=5.0, applied_V=1.0)
    state, _ = step_at(law, state, (10.0, 6.5, 1.0), (10.0, 9.0))
    assert state.law.history.force_mN == 6.5


@BOTH
def test_with_a_constant_reference_and_no_low_pass_both_force_ages_give_the_same_voltages(
    scheme: str,
) -> None:
    """F_r constant: F_{r,k} + F̂ - F_{r,k-1} is F̂."""
    runs: list[list[float]] = []
    for settings in (law_settings(scheme), law_settings(scheme, force_age="newest")):
        loop = Loop(law_of(settings), resting_arm(12.0, K_e=2.0, x_e_um=10.0))
        loop.force_r_mN = 8.0
        loop.change(loop.law)
        runs.append([loop.tick(13.0, 8.0).voltage_V for _ in range(30)])
    assert runs[0] == pytest.approx(runs[1], abs=1e-12)
    assert abs(runs[0][0] - runs[0][-1]) > 0.01


def test_a_state_of_another_law_is_refused() -> None:
    pbsmic, dsmifc = (law_of(law_settings(scheme)) for scheme in SCHEMES)
    at: dict[str, Any] = {"x_um": 1.0, "x_r_um": 1.0, "force_mN": 0.0}
    state = start(pbsmic, **at, applied_V=0.05)
    with pytest.raises(TypeError, match="rebase it first"):
        step(dsmifc, state, **at, applied_V=0.05, force_r_mN=0.0, limited=0)
    other = replace(state, law=start(dsmifc, **at, applied_V=0.05).law)
    with pytest.raises(TypeError, match="rebase it first"):
        step(pbsmic, other, **at, applied_V=0.05, force_r_mN=0.0, limited=0)
