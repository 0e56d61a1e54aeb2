"""Properties that both laws share, in closed loop with the model arm: gain, offset, rest,
limits, residual."""

from itertools import pairwise

import pytest

from pincette.control.arm.plant import ArmParameters
from pincette.control.laws.law import start
from pincette.control.laws.sliding import LawOutput
from tests.support.laws import law_settings, step_at

from .model_loop import ARM, SCHEMES, Loop, law_of, resting_arm

BOTH = pytest.mark.parametrize("scheme", SCHEMES)
PERIODS = pytest.mark.parametrize("period_s", [0.02, 0.001])


@BOTH
@PERIODS
@pytest.mark.parametrize(
    ("K_P", "K_I", "share"), [(5.0, 1.0, 1 / 6), (0.5, 1.0, 2 / 3), (1.0, 1.0, 1 / 2)]
)
def test_each_sample_reduces_the_error_by_the_same_share(
    scheme: str, period_s: float, K_P: float, K_I: float, share: float
) -> None:
    """A step of p at a steady reference: e (ε) = -p̃/k̄, and from there (1 - share) a sample."""
    loop = Loop(
        law_of(law_settings(scheme, K_P=K_P, K_I=K_I), period_s), resting_arm(10.0, period_s)
    )
    loop.tick(10.0)
    errors = [loop.tick(10.0, p_mN=1.5).error_um for _ in range(12)]
    assert errors[0] == pytest.approx(0.0, abs=1e-12)
    k_bar = loop.arm.plant.k_bar
    # DSMIFC's impedance stores ẽ in M̄ and B̄: ε, not e, decays by the share.
    assert errors[1] == pytest.approx(1.5 / k_bar, rel=1e-9)
    for before, after in pairwise(errors[1:]):
        assert after == pytest.approx((1.0 - share) * before, abs=1e-12)


@BOTH
@pytest.mark.parametrize("set_", ["consistent", "printed"])
@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_constant_reference_is_reached_with_zero_error_despite_a_wrong_model(
    scheme: str, set_: str, factor: float
) -> None:
    """The arm's d_p is 20 % below or 25 % above the law's, and p is 4 mN; the law knows neither."""
    own = ArmParameters(ARM.m, ARM.b, ARM.k, factor * ARM.d)
    settings = law_settings(scheme, "printed" if set_ == "printed" else "consistent", K_P=2.0)
    loop = Loop(law_of(settings), resting_arm(0.0, arm=own))
    for tick in range(150):
        loop.tick(25.0 * min(1.0, tick / 30.0), p_mN=4.0)
    assert loop.arm.x_um == pytest.approx(25.0, abs=1e-9)
    assert loop.arm.voltage_V == pytest.approx((own.k * 25.0 - 4.0) / own.d, abs=1e-9)


@BOTH
@PERIODS
def test_a_steady_arm_at_its_reference_keeps_its_voltage(scheme: str, period_s: float) -> None:
    law = law_of(law_settings(scheme, K_S=0.5, delta=0.5), period_s)
    loop = Loop(law, resting_arm(12.5, period_s, K_e=2.0, x_e_um=11.0))
    before_V = loop.arm.voltage_V
    for _ in range(10):
        output = loop.tick(12.5, 3.0)
        assert output.voltage_V == pytest.approx(before_V, abs=1e-12)
        assert output.residual_um == pytest.approx(0.0, abs=1e-12)
        assert output.x_d_um == pytest.approx(12.5, abs=1e-12)


@BOTH
def test_the_residual_is_computed_with_the_applied_voltage(scheme: str) -> None:
    """An arm that is the model: no residual and no p̃, though the voltage is clipped at 1 V."""
    loop = Loop(law_of(law_settings(scheme)), resting_arm(0.0), high_V=1.0)
    clipped = 0
    for tick in range(40):
        output = loop.tick(30.0 * min(1.0, tick / 20.0))
        assert output.residual_um == pytest.approx(0.0, abs=1e-9)
        assert output.perturbation_error_mN == pytest.approx(0.0, abs=1e-9)
        assert output.perturbation_mN == pytest.approx(0.0, abs=1e-9)
        clipped += output.voltage_V > 1.0
    assert clipped > 5
    assert loop.arm.x_um == pytest.approx(19.0)


@BOTH
def test_a_step_of_p_appears_in_its_estimate_one_sample_later(scheme: str) -> None:
    """p steps by 1.5 mN: p̂ has it one sample later, p̃ = p_{k-1} - p_k is -1.5 mN once."""
    loop = Loop(law_of(law_settings(scheme, force_age="newest")), resting_arm(10.0))
    outputs = [loop.tick(10.0, p_mN=1.5 * (tick >= 3)) for tick in range(8)]
    assert [o.perturbation_mN for o in outputs] == pytest.approx([0.0] * 4 + [1.5] * 4, abs=1e-9)
    wanted = [0.0] * 4 + [-1.5] + [0.0] * 3
    assert [o.perturbation_error_mN for o in outputs] == pytest.approx(wanted, abs=1e-9)


@BOTH
def test_a_limit_causes_no_windup(scheme: str) -> None:
    """The arm is held at 1 V, 11 µm below its reference, for 60 samples, then sent back to 10 µm.

    If ε is frozen meanwhile, s is at most K_P e afterwards. The switching term removes it within
    |s|/(a K_S) samples, a K_S = 0.18 µm; then the arm is at 10 µm. If ε is not frozen, s is 60
    times as large, and the switching term still keeps the arm away from 10 µm.
    """
    delta = 0.5 if scheme == "pbsmic" else 1e4
    law = law_of(law_settings(scheme, K_S=0.2, delta=delta))
    found: list[tuple[float, float]] = []
    for frozen in (True, False):
        loop = Loop(law, resting_arm(10.0), high_V=1.0)
        sliding: list[float] = []
        for tick in range(160):
            limited = int(frozen and loop.arm.voltage_V >= 1.0)
            sliding.append(loop.tick(30.0 if tick < 60 else 10.0, limited=limited).sliding_um)
        found.append((sliding[60], abs(loop.arm.x_um - 10.0)))
    (s_um, error_um), (wound_um, pushed_um) = found
    assert -12.0 < s_um < -10.0
    assert wound_um < -600.0
    assert error_um < 1e-3
    assert pushed_um == pytest.approx(2.0 / loop.arm.plant.k_bar * 0.2, rel=0.05)


@pytest.mark.parametrize("K_S", [0.0, 0.5])
def test_without_impedance_and_force_gain_both_laws_are_equal(K_S: float) -> None:
    """M = B = K_f = 0: x_d = x_r and ε = K̄ e, so that with δ̃ = K̄ δ DSMIFC is PBSMIC."""
    pbsmic = law_settings("pbsmic", K_P=2.0, K_S=K_S, delta=0.4, M=0.0, B=0.0, K_f=0.0)
    gains = {**pbsmic.gains, "delta": 0.4 * pbsmic.gains["K"]}
    dsmifc = law_settings("dsmifc", "consistent", "planned", **gains)
    runs: list[list[LawOutput]] = []
    for settings in (pbsmic, dsmifc):
        loop = Loop(law_of(settings), resting_arm(10.0, K_e=2.0, x_e_um=8.0))
        runs.append(loop.updated([(10.0 + 0.1 * min(tick, 20), 4.0) for tick in range(60)]))
    for one, other in zip(*runs, strict=True):
        assert one.voltage_V == pytest.approx(other.voltage_V, abs=1e-12)
        assert one.sliding_um == pytest.approx(other.sliding_um, abs=1e-11)


def test_dsmifc_keeps_its_share_of_an_initial_error() -> None:
    """ẽ = -1 µm as the segment begins: ε_k = K̃_P/(K̃_P + K̃_I) ε_{k-1}."""
    loop = Loop(law_of(law_settings("dsmifc", K_P=2.0)), resting_arm(30.0))
    loop.x_r_um = 31.0
    loop.change(loop.law)
    errors = [loop.tick(31.0).error_um for _ in range(12)]
    assert errors[0] == pytest.approx(-1.9901e4 / loop.law.parameters.impedance.K_bar)
    for before, after in pairwise(errors):
        assert after == pytest.approx(before * 2.0 / 3.0, rel=1e-9)


def test_pbsmic_removes_an_initial_distance_with_its_impedance() -> None:
    law = law_of(law_settings(), 0.001)
    state = start(law, x_um=30.0, x_r_um=31.0, force_mN=0.0, applied_V=1.0)
    desired: list[float] = []
    for _ in range(40):
        state, output = step_at(law, state, (30.0, 0.0, 1.0), (31.0, 0.0))
        desired.append(output.x_d_um)
    assert 30.0 < desired[0] < 30.8
    assert all(before <= after + 1e-9 for before, after in pairwise(desired))
    assert desired[-1] == pytest.approx(31.0, abs=1e-6)
