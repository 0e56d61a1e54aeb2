"""The estimator's step: inputs of equal age, missing partners, zeros, and a state that is kept
across epochs."""

from math import inf, isfinite, nan, sqrt

import pytest

from pincette.control.planning.program import Guards, Program
from pincette.control.record import replace
from pincette.core.faults import Fault, FaultCode
from pincette.core.messages import Estimate, Load
from pincette.core.service import RefusedError
from pincette.core.wording import fault_text, named_text
from pincette_estimator.config import EstimatorConfig, configure
from pincette_estimator.step import Inputs, handle, start, step
from tests.support.arms import with_arm
from tests.unit.estimator.bench import APPLIED, DEMO, POSITION, TAUGHT, Bench, a_rig

LINEAR = configure(a_rig(None))
IDENTIFIED = configure(a_rig(TAUGHT))
BOTH = pytest.mark.parametrize("config", [LINEAR, IDENTIFIED], ids=["linear", "identified"])


def test_position_and_voltage_of_the_same_age_give_no_force() -> None:
    bench = Bench(LINEAR)
    for tick in range(50):
        voltage_V = 0.03 * tick
        estimate = bench.feed(19.0 * voltage_V, voltage_V)
        assert estimate.arms[0].force_mN == pytest.approx(0.0, abs=1e-9)
        assert estimate.applied_seq == estimate.seq - 1


@BOTH
def test_a_pressed_arm_has_a_positive_force(config: EstimatorConfig) -> None:
    bench = Bench(config)
    bench.rest(0.0, 0.0)
    free_um = bench.state.arms[0].response.position_um()
    assert bench.feed(free_um - 4.6, 0.0).arms[0].force_mN == pytest.approx(10.0)


@BOTH
def test_an_estimate_without_an_applied_voltage_is_degraded(config: EstimatorConfig) -> None:
    bench = Bench(config)
    bench.rest(0.0, 0.0)
    estimate = bench.feed(1.0, None)
    assert (estimate.valid, estimate.degraded, estimate.applied_seq) == (False, True, -1)
    assert bench.feed(0.0, 0.0).valid


@BOTH
def test_a_zero_is_refused_while_a_part_is_held(config: EstimatorConfig) -> None:
    bench = Bench(config)
    bench.rest(0.0, 0.0)
    estimate = bench.feed(0.0, 0.0, zero=True, held=True)
    assert "a part is held" in fault_text(estimate.arms[0].zero_refusal)
    assert estimate.arms[0].zero_age_s is None


@BOTH
def test_a_zero_removes_the_offset_and_starts_its_age(config: EstimatorConfig) -> None:
    bench = Bench(config)
    bench.rest(0.0, 0.0)
    bench.rest(0.4, 0.0)
    estimate = bench.feed(0.4, 0.0, zero=True)
    assert estimate.arms[0].zero_refusal is None
    assert estimate.arms[0].zero_age_s == 0.0
    assert estimate.arms[0].force_mN == pytest.approx(0.0, abs=1e-9)
    assert bench.feed(0.4, 0.0).arms[0].zero_age_s == pytest.approx(0.02)


def test_hysteresis_memory_and_offset_outlive_an_arming() -> None:
    bench = Bench(IDENTIFIED)
    bench.rest(0.0, 0.0)
    bench.feed(0.0, 0.0, zero=True)
    for voltage_V in (1.0, 2.0, 1.0):
        bench.feed(0.0, voltage_V, held=True)
    before = bench.state.arms[0].response
    bench.arm(2)
    assert bench.state.arms[0].response == before
    pushed_um = 3.0 * IDENTIFIED.arms[0].compliance_um_per_mN
    estimate = bench.feed(before.updated(1.0, 0.02).position_um() - pushed_um, 1.0)
    assert estimate.arms[0].zero_age_s is None
    assert estimate.arms[0].zero_refusal is None
    assert estimate.arms[0].force_mN == pytest.approx(3.0)
    # Falling from 2 V the play of 0.5 V rests until 1 V, then moves: 15 µm/V from there.
    fallen = bench.state.arms[0].response.updated(0.9, 0.0).position_um()
    assert bench.state.arms[0].response.position_um() - fallen == pytest.approx(
        0.1 * 15.0, rel=0.01
    )


def test_a_confirmed_zero_discards_the_offset_of_earlier_epochs() -> None:
    bench = Bench(IDENTIFIED)
    bench.rest(0.0, 0.0)
    bench.feed(0.0, 0.0, zero=True)
    bench.arm(2, zero_confirmed=True)
    assert bench.feed(-4.6, 0.0).arms[0].force_mN == pytest.approx(0.0)


@pytest.mark.parametrize("config", [LINEAR, IDENTIFIED], ids=["linear", "identified"])
def test_a_part_that_presses_at_rest_is_never_zeroed(config: EstimatorConfig) -> None:
    bench = Bench(config)
    bench.rest(0.0, 0.0)
    assert bench.feed(0.0, 0.0, zero=True).arms[0].zero_refusal is None
    pushed_um = 25.0 * config.arms[0].compliance_um_per_mN
    for epoch in range(2, 7):
        bench.arm(epoch)
        bench.rest(-pushed_um, 0.0)
        estimate = bench.feed(-pushed_um, 0.0, zero=True)
        assert estimate.arms[0].zero_refusal is not None
        assert estimate.arms[0].zero_refusal.code == FaultCode.ZERO_OFFSET
        assert estimate.arms[0].force_mN == pytest.approx(25.0, abs=0.1)
    bench.arm(7, zero_confirmed=True)
    bench.rest(-pushed_um, 0.0)
    assert bench.feed(-pushed_um, 0.0, zero=True).arms[0].zero_age_s == 0.0


def test_a_zero_is_accepted_after_removal_of_a_part_that_pressed_during_the_previous_zero() -> None:
    """A zero was taken while a part pressed, which was then removed: the reading is not a force."""
    bench = Bench(IDENTIFIED)
    bench.rest(-9.0, 0.0)
    bench.feed(-9.0, 0.0, zero=True)
    bench.arm(2)
    bench.rest(0.0, 0.0)
    assert bench.feed(0.0, 0.0, zero=True).arms[0].zero_age_s == 0.0


def test_the_force_of_a_held_part_outlives_an_arming() -> None:
    bench = Bench(IDENTIFIED)
    bench.rest(0.0, 0.0)
    bench.feed(0.0, 0.0, zero=True)
    bench.rest(-6.9, 0.0, count=100)
    for held_um in (-6.9, 6.9):
        bench.arm(bench.epoch + 1)
        estimate = bench.feed(held_um, 0.0, held=True)
        wanted_mN = -held_um / IDENTIFIED.arms[0].compliance_um_per_mN
        assert estimate.arms[0].force_mN == pytest.approx(wanted_mN, abs=0.05)


def test_a_new_model_is_initialized_with_the_past_voltages_of_the_arm() -> None:
    bench, other = Bench(LINEAR), Bench(IDENTIFIED)
    for one in (bench, other):
        for voltage_V in (0.0, 1.0, 2.0, 1.0):
            one.feed(0.0, voltage_V)
    bench.config = IDENTIFIED
    offset_um = bench.state.arms[0].response.position_um()
    for one in (bench, other):
        one.arm(2, zero_confirmed=one is other)
    assert bench.state.arms[0].response.position_um() == pytest.approx(offset_um)
    bench.arm(3, zero_confirmed=True)
    for one in (bench, other):
        one.feed(12.0, 1.0)
    assert bench.state.arms[0].model == IDENTIFIED.arms[0].response
    there, wanted = (
        one.state.arms[0].response.updated(0.2, 0.0).position_um() for one in (bench, other)
    )
    assert there == pytest.approx(wanted, abs=1e-3)


def test_another_compliance_changes_only_the_force() -> None:
    bench = Bench(LINEAR)
    bench.config = configure(a_rig(None, compliance_um_per_mN=0.92))
    bench.arm(2)
    bench.feed(0.0, 0.0)
    assert bench.feed(-0.92, 0.0).arms[0].force_mN == pytest.approx(1.0)


def test_an_invalid_estimate_states_why() -> None:
    bench = Bench(LINEAR)
    assert fault_text(bench.feed(0.0, None).fault) == "no voltage for the sample before"
    broken = with_arm(
        POSITION, seq=1, valid=False, fault=Fault(FaultCode.INSTRUMENT_SILENT, (), "laser off")
    )
    _, (estimate,) = step(LINEAR, bench.state, Inputs(broken, None), 0.0)
    assert isinstance(estimate, Estimate)
    assert named_text(estimate.fault) == "sensor: laser off"


def test_the_hysteresis_memory_advances_at_samples_without_a_position() -> None:
    bench, other = Bench(IDENTIFIED), Bench(IDENTIFIED)
    bench.feed(0.0, 0.0)
    other.feed(0.0, 0.0)
    bench.feed(5.0, 1.0)
    assert not other.feed(nan, 1.0).valid
    assert bench.state.arms[0].response.updated(0.0, 0.0) == other.state.arms[0].response.updated(
        0.0, 0.0
    )


@BOTH
@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_invalid_numbers_are_rejected(config: EstimatorConfig, value: float) -> None:
    bench = Bench(config)
    bench.rest(0.0, 0.0)
    for estimate in (bench.feed(value, 0.0), bench.feed(0.0, value)):
        assert not estimate.valid
        assert isfinite(estimate.arms[0].force_mN)
    estimate = bench.feed(0.0, 0.0)
    assert estimate.valid
    assert abs(estimate.arms[0].force_mN) < 1e-6
    assert isfinite(estimate.arms[0].force_uncertainty_mN)
    assert isfinite(estimate.arms[0].perturbation_mN)


@BOTH
def test_a_sample_of_another_epoch_is_counted_and_dropped(config: EstimatorConfig) -> None:
    bench = Bench(config)
    stray = replace(POSITION, epoch=7)
    state, outputs = step(config, bench.state, Inputs(stray, APPLIED), 0.0)
    assert outputs == ()
    assert state.refused == 1
    assert step(config, state, Inputs(None, APPLIED), 0.0) == (state, ())


def test_the_estimator_accepts_only_arming_requests() -> None:
    guards = Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.5, 1.0)
    with pytest.raises(RefusedError, match="does not answer Load"):
        handle(LINEAR, start(LINEAR), Load(Program((), guards, 2.0)), 0.0)


def test_the_published_force_has_no_low_pass() -> None:
    bench = Bench(configure(a_rig(TAUGHT, force_filter_s=0.5)))
    bench.rest(0.0, 0.0)
    free_um = bench.state.arms[0].response.position_um()
    assert bench.feed(free_um - 4.6, 0.0).arms[0].force_mN == pytest.approx(10.0)
    free_um = bench.state.arms[0].response.position_um()
    assert bench.feed(free_um, 0.0).arms[0].force_mN == pytest.approx(0.0, abs=1e-9)


def test_the_perturbation_uses_the_estimators_own_force() -> None:
    bench = Bench(LINEAR)
    bench.rest(0.0, 0.0)
    plant = LINEAR.arms[0].plant
    for x_um, voltage_V in ((1.0, 0.1), (2.5, 0.2), (3.0, 0.3)):
        estimate = bench.feed(x_um, voltage_V)
    wanted_mN = (
        -plant.d_bar * 0.3
        + plant.m_bar * 1.0
        + plant.b_bar * 2.5
        + plant.k_bar * 3.0
        + estimate.arms[0].force_mN
    )
    assert estimate.arms[0].perturbation_mN == pytest.approx(wanted_mN)


def test_the_uncertainty_grows_with_the_motion_back_and_forth_since_the_zero() -> None:
    (arm,) = IDENTIFIED.arms
    bench = Bench(replace(IDENTIFIED, arms=(replace(arm, forgotten_mN=3.0),)))
    bench.rest(0.0, 0.0)
    bench.feed(0.0, 0.0, zero=True)
    before = bench.feed(0.0, 0.0).arms[0].force_uncertainty_mN
    for tick in range(100):
        bench.feed(0.0, 0.004 * (tick % 2))
    assert bench.feed(0.0, 0.0).arms[0].force_uncertainty_mN > before + 2.0


def test_the_uncertainty_of_a_long_hold_grows_by_the_creep_of_the_whole_stroke() -> None:
    """The creep time identified is 1 s: from 10 s on each decade adds 1.5 % of 30 µm."""
    taught = TAUGHT.model_copy(update={"creep_percent_per_decade": 1.5})
    quiet = TAUGHT.model_copy(update={"creep_percent_per_decade": 0.0})
    stated_mN: list[list[float]] = []
    for each in (taught, quiet):
        bench = Bench(configure(a_rig(each)))
        bench.rest(0.0, 0.0)
        bench.feed(0.0, 0.0, zero=True)
        stated_mN.append([bench.feed(20.0, 2.0).arms[0].force_uncertainty_mN for _ in range(5002)])
    assert stated_mN[0][400] == pytest.approx(stated_mN[1][400])
    s_p, d_p = DEMO.model.compliance_um_per_mN, DEMO.model.piezo_um_per_V
    late_mN = sqrt(stated_mN[0][-1] ** 2 - stated_mN[1][-1] ** 2)
    assert late_mN == pytest.approx(0.015 * 2.0 * d_p / s_p, rel=0.02)
