"""Two arms: each is estimated as if it were the only one, and their difference is monitored."""

from math import sin

import pytest
from msgspec.structs import replace

from pincette.config import RigFile
from pincette.core.faults import FaultCode
from pincette.core.messages import Estimate
from pincette.core.messages.arms import ArmApplied, ArmPosition
from pincette_estimator.config import configure
from pincette_estimator.step import SERVICE, Inputs, step
from tests.support.two_arms import two_arm_rig
from tests.unit.estimator.bench import APPLIED, POSITION, Bench

RIG: RigFile = two_arm_rig()


class PairBench(Bench):
    """Feeds an estimator of two arms."""

    def feed_both(
        self,
        tips_um: tuple[float, float],
        voltages_V: tuple[float, float],
        *,
        zero: bool = False,
        held: bool = False,
        second_valid: bool = True,
    ) -> Estimate:
        applied = replace(
            APPLIED,
            seq=self.seq - 1,
            arms=(ArmApplied(voltages_V[0], 0), ArmApplied(voltages_V[1], 0)),
            zero=zero,
            part_held=held,
        )
        arms = ArmPosition(tips_um[0], valid=True), ArmPosition(tips_um[1], valid=second_valid)
        position = replace(POSITION, seq=self.seq, arms=arms)
        self.state, (found,) = step(self.config, self.state, Inputs(position, applied), 0.0)
        self.seq += 1
        assert isinstance(found, Estimate)
        return found


def course(seq: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return voltages of both, and tip positions close to their free responses."""
    voltages = 0.5 + 0.4 * sin(0.05 * seq), 0.6 - 0.3 * sin(0.08 * seq)
    return (19.0 * voltages[0], 18.5 * voltages[1]), voltages


def test_each_of_two_arms_has_the_same_estimate_as_a_single_arm() -> None:
    both = PairBench(configure(RIG))
    alone = [Bench(configure(arm)) for arm in RIG.arms]
    for seq in range(120):
        tips, voltages = course(seq)
        found = both.feed_both(tips, voltages, zero=seq == 60)
        one, two = (
            bench.feed(tip, u, zero=seq == 60)
            for bench, tip, u in zip(alone, tips, voltages, strict=True)
        )
        assert len(found.arms) == 2
        assert (found.arms[0].force_mN, found.arms[0].force_uncertainty_mN) == (
            one.arms[0].force_mN,
            one.arms[0].force_uncertainty_mN,
        )
        assert (found.arms[1].force_mN, found.arms[1].force_uncertainty_mN) == (
            two.arms[0].force_mN,
            two.arms[0].force_uncertainty_mN,
        )
        assert found.arms[1].zero_refusal == two.arms[0].zero_refusal
        assert found.arms[1].zero_age_s == two.arms[0].zero_age_s


def test_a_sample_without_the_second_measurement_is_not_valid() -> None:
    bench = PairBench(configure(RIG))
    bench.feed_both((0.0, 0.0), (0.0, 0.0))
    found = bench.feed_both((0.0, 0.0), (0.0, 0.0), second_valid=False)
    assert not found.valid
    assert len(found.arms) == 2
    assert bench.feed_both((0.0, 0.0), (0.0, 0.0)).valid


def rest(bench: PairBench, ticks: int, apart_mN: float, *, held: bool) -> Estimate:
    """Keep both arms at one voltage; the first is pushed back as by a force."""
    back_um = apart_mN * RIG.model.compliance_um_per_mN
    found = bench.feed_both((-back_um, 0.0), (0.0, 0.0), held=held)
    for _ in range(ticks - 1):
        found = bench.feed_both((-back_um, 0.0), (0.0, 0.0), held=held)
    return found


def zeroed() -> PairBench:
    bench = PairBench(configure(RIG))
    rest(bench, 60, 0.0, held=False)
    found = bench.feed_both((0.0, 0.0), (0.0, 0.0), zero=True)
    assert found.arms[0].zero_age_s == 0.0
    assert len(found.arms) == 2
    assert found.arms[1].zero_age_s == 0.0
    return bench


def codes(bench: PairBench) -> set[FaultCode]:
    return {fault.code for fault in bench.state.findings}


def test_forces_that_differ_beyond_their_uncertainty_are_a_finding() -> None:
    bench = zeroed()
    last = rest(bench, 150, 20.0, held=True)
    difference_mN = last.arms[0].force_mN - last.arms[1].force_mN
    assert difference_mN == pytest.approx(20.0, abs=0.5)
    assert FaultCode.FORCES_DISAGREE in codes(bench)
    rest(bench, 1, 0.0, held=False)
    assert FaultCode.FORCES_DISAGREE not in codes(bench)


@pytest.mark.parametrize(
    ("ticks", "apart_mN", "held"), [(30, 20.0, True), (150, 0.05, True), (150, 20.0, False)]
)
def test_differences_of_two_forces_that_are_short_or_small_are_ignored(
    ticks: int, apart_mN: float, held: bool
) -> None:
    bench = zeroed()
    rest(bench, ticks, apart_mN, held=held)
    assert FaultCode.FORCES_DISAGREE not in codes(bench)


def test_an_arming_keeps_the_hysteresis_memory_of_both_arms() -> None:
    bench = PairBench(configure(RIG))
    for seq in range(40):
        tips, voltages = course(seq)
        bench.feed_both(tips, voltages)
    before = bench.state
    bench.arm(2)
    for arm, earlier in zip(bench.state.arms, before.arms, strict=True):
        assert arm.response == earlier.response
    assert bench.state.epoch == 2
    assert "arms" in SERVICE.state_snapshot


@pytest.mark.parametrize("arm", [0, 1])
def test_sensors_at_rest_while_both_arms_press_harder_are_not_reported_as_stuck(arm: int) -> None:
    bench = PairBench(configure(RIG))
    at = 29.9, 30.4
    bench.feed_both(at, (1.5, 1.5), held=True)
    pressed = [
        bench.feed_both(at, (1.5 + 0.01 * tick, 1.5 + 0.01 * tick), held=True) for tick in range(30)
    ]
    assert all(each.valid for each in pressed)
    # A moving part is visible in both tips.
    moved: list[Estimate] = []
    for tick in range(1, 14):
        tips = [at[0] + 0.19 * tick, at[1] - 0.19 * tick]
        tips[arm] = at[arm]
        volts = 1.8 + 0.01 * tick, 1.8 - 0.01 * tick
        moved.append(bench.feed_both((tips[0], tips[1]), volts, held=True))
    assert not moved[-1].valid
    assert moved[-1].fault is not None
    assert moved[-1].fault.code is FaultCode.SENSOR_STUCK
