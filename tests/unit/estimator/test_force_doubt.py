"""A step of the position that a slip or the sensor may have caused widens U until the next zero."""

from math import sqrt

import pytest

from pincette.core.messages import Arm
from pincette.core.messages.arms import ArmEstimate
from pincette_estimator.config import configure
from pincette_estimator.step import handle
from tests.unit.estimator.bench import TAUGHT, Bench, a_rig

HELD_V, STEP_UM, PRESSED_MN = 0.5, 2.0, 15.0
RIG = a_rig(TAUGHT)
SIZE_UM = STEP_UM + 2.0 * RIG.sensor.noise_um * sqrt(1 / 8 + 1 / 8)
DOUBT_MN = SIZE_UM / RIG.model.compliance_um_per_mN
"""Force of the step, and the expanded uncertainty of its size: means of 8 samples before and after
it."""


class Held(Bench):
    """An arm that presses a part."""

    def __init__(self) -> None:
        super().__init__(configure(RIG))
        self.zero()

    def zero(self) -> None:
        self.rest(self.free_um, HELD_V)
        self.rest(self.free_um, HELD_V)
        assert self.feed(self.free_um, HELD_V, zero=True).arms[0].zero_age_s == 0.0

    @property
    def free_um(self) -> float:
        return self.state.arms[0].response.position_um()

    def read(self, step_um: float | None = None, *, answered: bool = True) -> ArmEstimate:
        """Feed a position that reads as the force of the part."""
        x_um = self.free_um - self.config.arms[0].compliance_um_per_mN * PRESSED_MN
        found = self.feed(x_um, HELD_V, held=True, step_um=step_um, answered=answered)
        return found.arms[0]

    def take_over(self) -> None:
        """Begin a program that holds the part, with the zero of the earlier one."""
        request = Arm(self.epoch + 1, 1, "", zero_kept=True)
        self.state, _, _ = handle(self.config, self.state, request, 0.0)
        self.epoch, self.seq = self.epoch + 1, 0


@pytest.mark.parametrize("step_um", [STEP_UM, -STEP_UM])
def test_the_uncertainty_contains_the_largest_force_of_the_other_cause(step_um: float) -> None:
    bench, undisturbed = Held(), Held()
    assert bench.read().force_doubt_mN == undisturbed.read().force_doubt_mN == 0.0
    for answered in (True, False, True):
        found = bench.read(step_um if answered else None, answered=answered)
        own_mN = undisturbed.read(answered=answered).force_uncertainty_mN
        assert found.force_doubt_mN == pytest.approx(DOUBT_MN)
        assert found.force_uncertainty_mN == pytest.approx(own_mN + DOUBT_MN)


def test_the_doubt_lasts_until_the_next_zero_also_in_the_next_job_with_the_part() -> None:
    bench = Held()
    bench.read(STEP_UM)
    bench.take_over()
    assert bench.read().force_doubt_mN == pytest.approx(DOUBT_MN)
    bench.arm(bench.epoch + 1)
    bench.zero()
    assert bench.read().force_doubt_mN == 0.0
