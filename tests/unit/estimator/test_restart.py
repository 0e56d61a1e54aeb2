"""An estimator that is restarted for an arm with a history: the simulated arm, moved freely.

The arm is always free, so its true force is zero.
"""

import random
from dataclasses import replace

import pytest

from pincette.core.faults import FaultCode
from pincette.core.messages import Arm, Estimate
from pincette.core.wording import faults_text
from pincette.engine.request_log import restored, snapshot
from pincette.sim.plant import plant
from pincette.sim.plant.plant import PlantParameters
from pincette_estimator.config import configure
from pincette_estimator.step import SERVICE, handle

from .bench import DEMO, TAUGHT, Bench, a_rig

SEEDS = range(8)
ZERO_V, PRESS_V = 0.8, 2.2
PERIOD_S = DEMO.rig.period_s
LOCKSTEP = DEMO.model_copy(update={"rig": DEMO.rig.model_copy(update={"time": "lockstep"})})


@pytest.fixture
def free() -> PlantParameters:
    assert DEMO.simulation is not None
    return replace(plant.plant_parameters(DEMO.simulation), environment_stiffness_mN_per_um=0.0)


class FreeArm:
    """The simulated arm without a part, and an estimator that can be restarted."""

    def __init__(self, parameters: PlantParameters) -> None:
        self.parameters, self.state, self.at_V = parameters, plant.start(), 0.0
        self.bench = Bench(configure(DEMO))

    def move(self, to_V: float, speed_V_per_s: float = 2.0) -> list[Estimate]:
        ticks = max(1, round(abs(to_V - self.at_V) / speed_V_per_s / PERIOD_S))
        from_V = self.at_V
        return [self.tick(from_V + (to_V - from_V) * k / ticks) for k in range(1, ticks + 1)]

    def tick(self, voltage_V: float, *, zero: bool = False) -> Estimate:
        self.state = plant.set_voltage(self.parameters, self.state, voltage_V)
        self.state = plant.advance(self.parameters, self.state, PERIOD_S)
        self.at_V = voltage_V
        return self.bench.feed(self.state.x_um, voltage_V, zero=zero)

    def zero(self) -> None:
        self.rest(0.4)
        zeroed = self.tick(self.at_V, zero=True)
        assert zeroed.arms[0].zero_refusal is None
        assert zeroed.arms[0].zero_age_s == 0.0

    def rest(self, seconds: float) -> list[Estimate]:
        return [self.tick(self.at_V) for _ in range(round(seconds / PERIOD_S))]

    def stroke(self, epoch: int, *, from_zero: bool = False) -> list[Estimate]:
        """Play a stroke as in a grip: zero half way up, then to the voltage that presses, and hold.

        With ``from_zero`` there is a zero before the motion, too.
        """
        self.bench.arm(epoch)
        if from_zero:
            self.zero()
        self.move(ZERO_V)
        self.zero()
        found = [*self.move(PRESS_V), *self.rest(2.0)]
        self.move(0.0)
        self.rest(0.5)
        return found


def a_past(arm: FreeArm, seed: int) -> None:
    """Play random strokes and rests, and return the arm to 0 V."""
    draw = random.Random(seed)
    for _ in range(draw.randint(1, 4)):
        arm.move(draw.uniform(0.0, 3.5))
        arm.rest(draw.uniform(0.0, 3.0))
    arm.move(0.0)
    arm.rest(draw.uniform(0.0, 3.0))


@pytest.mark.parametrize("from_zero", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_force_after_a_restart_is_within_its_uncertainty(
    free: PlantParameters, seed: int, *, from_zero: bool
) -> None:
    arm = FreeArm(free)
    a_past(arm, seed)
    arm.bench = Bench(configure(DEMO))
    beyond = [
        (one.arms[0].force_mN, one.arms[0].force_uncertainty_mN)
        for one in arm.stroke(2, from_zero=from_zero)
        if abs(one.arms[0].force_mN) > one.arms[0].force_uncertainty_mN
    ]
    assert beyond == [], f"seed {seed}"


def test_without_a_restart_the_same_stroke_has_a_smaller_error(free: PlantParameters) -> None:
    """The error comes from the restart: an estimator that continues knows the history, a new one
    does not."""
    worst: dict[bool, float] = {}
    for restarts in (False, True):
        arm = FreeArm(free)
        arm.stroke(1)
        if restarts:
            arm.bench = Bench(configure(DEMO))
        worst[restarts] = max(abs(one.arms[0].force_mN) for one in arm.stroke(2))
    assert worst[True] > 2.0 * worst[False]


def test_a_stroke_without_an_earlier_zero_keeps_a_large_uncertainty_of_an_unknown_arm(
    free: PlantParameters,
) -> None:
    held = {known: FreeArm(free).stroke(1, from_zero=known)[-1] for known in (False, True)}
    assert held[False].arms[0].force_uncertainty_mN > 3.0
    assert abs(held[True].arms[0].force_mN) < held[True].arms[0].force_uncertainty_mN < 1.0


@pytest.mark.parametrize("low_V", [0.0, -1.0])
def test_an_approach_before_the_zero_does_not_reduce_the_unknown_history(
    free: PlantParameters, low_V: float
) -> None:
    """U once contained only a quarter of the unknown history, with zeros before and after the
    approach."""
    model = DEMO.model
    assert model.free_response is not None
    taught = model.free_response.model_copy(update={"taught_V": (low_V, 3.0)})
    limits = DEMO.limits.model_copy(update={"voltage_min_V": low_V})
    changed = {"limits": limits, "model": model.model_copy(update={"free_response": taught})}
    stated_mN: list[float] = []
    for from_zero in (False, True):
        arm = FreeArm(free)
        arm.bench = Bench(configure(DEMO.model_copy(update=changed)))
        held = arm.stroke(1, from_zero=from_zero)[-1].arms[0]
        stated_mN.append(held.force_uncertainty_mN)
    assert stated_mN[1] > 0.5 * stated_mN[0]


def test_a_stroke_reduces_the_unknown_past(free: PlantParameters) -> None:
    arm = FreeArm(free)
    first, second = arm.stroke(1), arm.stroke(2)
    assert second[-1].arms[0].force_uncertainty_mN < 0.5 * first[-1].arms[0].force_uncertainty_mN


def test_the_unknown_past_is_reported_until_strokes_have_erased_it(
    free: PlantParameters,
) -> None:
    arm = FreeArm(free)
    (reported,) = arm.bench.state.findings
    assert reported.code is FaultCode.MEMORY_UNKNOWN
    assert "not known" in faults_text((reported,))
    limits = DEMO.limits
    for to_V in (limits.voltage_min_V, limits.voltage_max_V, 0.0):
        arm.move(to_V)
    arm.rest(200.0)
    arm.bench.arm(2)
    assert arm.bench.state.findings == ()
    assert arm.bench.state.arms[0].unknown.known


def test_in_lockstep_the_past_of_a_new_arm_is_unknown() -> None:
    bench = Bench(configure(LOCKSTEP))
    assert [finding.code for finding in bench.state.findings] == [FaultCode.MEMORY_UNKNOWN]


def test_a_linear_response_has_no_unknown_history() -> None:
    assert Bench(configure(a_rig(None))).state.arms[0].unknown.known


def test_an_arming_with_another_model_leaves_the_history_unknown() -> None:
    bench = Bench(configure(DEMO))
    bench.rest(0.0, 0.0)
    for to_V in (0.5, 0.2):
        bench.rest(0.0, to_V)
    other = configure(a_rig(TAUGHT))
    bench.state, _, _ = handle(other, bench.state, Arm(2, 1, ""), 0.0)
    assert not bench.state.arms[0].unknown.known
    assert (
        bench.state.arms[0].unknown.lowest.voltage_V
        == bench.state.arms[0].response.voltage_V
        == 0.2
    )


def test_a_replay_starts_with_the_same_past(free: PlantParameters) -> None:
    arm = FreeArm(free)
    arm.stroke(1)
    arm.bench.arm(2)
    config, state = arm.bench.config, arm.bench.state
    assert not state.arms[0].unknown.known
    fresh = Bench(config).state
    found = restored(SERVICE, config, fresh, snapshot(SERVICE, config, state))
    assert found.arms[0].unknown == state.arms[0].unknown
