"""A held part whose force reads a pull: the zero is invalid, and no force is stated."""

import pytest

from pincette.core.faults import FaultCode, Mode
from pincette.core.messages import Arm, Estimate
from pincette_estimator.config import EstimatorConfig, configure
from pincette_estimator.state import PULLS
from pincette_estimator.step import handle
from tests.unit.estimator.bench import TAUGHT, Bench, a_rig

BOTH = pytest.mark.parametrize(
    "config", [configure(a_rig(None)), configure(a_rig(TAUGHT))], ids=["linear", "identified"]
)
HELD_V, OPENED_V, PRESSED_MN, PULL_MN = 0.5, 0.2, 15.0, 8.0


class Held(Bench):
    """An arm that has pressed a part."""

    def __init__(self, config: EstimatorConfig) -> None:
        super().__init__(config)
        self.rest(config.arms[0].response.position_um(), HELD_V)
        self.rest(self.free_um, HELD_V)
        assert self.feed(self.free_um, HELD_V, zero=True).arms[0].zero_age_s == 0.0
        for _ in range(20):
            self.read(PRESSED_MN)

    @property
    def free_um(self) -> float:
        return self.state.arms[0].response.position_um()

    def read(self, force_mN: float, voltage_V: float = HELD_V, mode: Mode = Mode.ARMED) -> Estimate:
        """Feed a position that reads as a force."""
        s_p = self.config.arms[0].compliance_um_per_mN
        return self.feed(self.free_um - s_p * force_mN, voltage_V, held=True, state=mode)

    def take_over(self, *, zero_kept: bool = True) -> None:
        """Begin a program that holds the part, with the zero of the earlier one."""
        request = Arm(self.epoch + 1, 1, "", zero_kept=zero_kept)
        self.state, _, _ = handle(self.config, self.state, request, 0.0)
        self.epoch, self.seq = self.epoch + 1, 0

    @property
    def found(self) -> bool:
        return FaultCode.ZERO_INVALID in [finding.code for finding in self.state.findings]


def is_stated(estimate: Estimate) -> bool:
    (arm,) = estimate.arms
    invalid = arm.zero_refusal is not None and arm.zero_refusal.code == FaultCode.ZERO_INVALID
    assert invalid is not (arm.zero_age_s is not None)
    return arm.zero_age_s is not None


@BOTH
@pytest.mark.parametrize("mode", [Mode.ARMED, Mode.FROZEN])
def test_a_pull_at_the_voltage_that_pressed_ends_the_zero(
    config: EstimatorConfig, mode: Mode
) -> None:
    bench = Held(config)
    stated = [is_stated(bench.read(-PULL_MN, mode=mode)) for _ in range(PULLS + 1)]
    assert stated == [True] * (PULLS - 1) + [False, False]
    assert bench.found


@BOTH
def test_a_pull_at_the_first_sample_after_a_kept_zero_is_never_stated(
    config: EstimatorConfig,
) -> None:
    bench = Held(config)
    bench.take_over()
    assert not is_stated(bench.read(-PULL_MN))
    bench.take_over()
    assert bench.read(-PULL_MN).arms[0].zero_age_s is None
    assert bench.found


def taken_over_with_an_invalid_zero(config: EstimatorConfig) -> Held:
    """Return the estimator of a held part that another job has taken over after pulls."""
    bench = Held(config)
    for _ in range(PULLS):
        bench.read(-PULL_MN)
    bench.take_over(zero_kept=False)
    return bench


@BOTH
def test_an_invalid_zero_is_reported_to_the_job_that_releases_the_part(
    config: EstimatorConfig,
) -> None:
    bench = taken_over_with_an_invalid_zero(config)
    assert not is_stated(bench.read(-PULL_MN))
    assert bench.found


@BOTH
def test_an_invalid_zero_is_not_reported_to_a_job_that_begins_without_a_part(
    config: EstimatorConfig,
) -> None:
    bench = taken_over_with_an_invalid_zero(config)
    (arm,) = bench.feed(bench.free_um, HELD_V).arms
    assert (arm.zero_age_s, arm.zero_refusal) == (None, None)
    assert not bench.found


@BOTH
def test_a_held_part_keeps_its_zero(config: EstimatorConfig) -> None:
    bench = Held(config)
    bench.take_over()
    stated = [is_stated(bench.read(force_mN)) for force_mN in (PRESSED_MN, 0.0, *[PRESSED_MN] * 20)]
    assert all(stated)
    assert not bench.found


@BOTH
def test_an_arm_that_was_opened_may_be_pulled_by_a_part_that_sticks(
    config: EstimatorConfig,
) -> None:
    bench = Held(config)
    pulled = [bench.read(-PULL_MN, voltage_V=OPENED_V) for _ in range(3 * PULLS)]
    assert pulled[-1].arms[0].force_mN < -5.0
    assert all(map(is_stated, pulled))
    assert not bench.found


@BOTH
def test_a_ring_is_no_pull(config: EstimatorConfig) -> None:
    bench = Held(config)
    ring = [is_stated(bench.read(-PULL_MN if tick % PULLS else 0.0)) for tick in range(5 * PULLS)]
    assert all(ring)


@BOTH
def test_a_new_zero_ends_the_finding(config: EstimatorConfig) -> None:
    bench = Held(config)
    for _ in range(PULLS):
        bench.read(-PULL_MN)
    bench.arm(bench.epoch + 1)
    bench.rest(bench.free_um, HELD_V)
    assert is_stated(bench.feed(bench.free_um, HELD_V, zero=True))
    assert not bench.found
