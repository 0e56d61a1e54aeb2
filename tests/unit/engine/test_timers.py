"""When a service steps: the grid of a sensor, the timer of an actuator, and refused samples."""

from math import pi
from pathlib import Path

import pytest
from msgspec.structs import replace

from pincette.config import Calibration, read_rig
from pincette.control.quantities import Document
from pincette.core.idle_sampling import SAMPLE_S
from pincette.core.messages import (
    Ack,
    Arm,
    Estimate,
    Idle,
    Message,
    Position,
    Reset,
    Status,
    StatusRequest,
)
from pincette.engine.joiner import KEPT
from pincette.engine.runner import EARLY, IDLE_S, Runner
from pincette_actuator import SERVICE as ACTUATOR
from pincette_estimator import SERVICE as ESTIMATOR
from pincette_sensor import SERVICE as SENSOR
from tests.unit.engine import samples
from tests.unit.engine.instruments import Laser, Output
from tests.unit.engine.samples import ARMED as APPLIED

RIG = read_rig(Path("deploy/rigs/demo.toml"))
LOCKSTEP = RIG.model_copy(update={"rig": RIG.rig.model_copy(update={"time": "lockstep"})})
T = RIG.rig.period_s

POSITION = replace(samples.POSITION, epoch=1)


def sensor() -> Runner:
    runner = Runner(SENSOR, RIG, Laser())
    runner.begin(10.0)
    return runner


def estimator(epoch: int = 1) -> Runner:
    runner = Runner(ESTIMATOR, RIG)
    runner.begin(10.0)
    reply, _ = runner.call(Arm(epoch, 1, RIG.digest()), 10.0)
    assert not isinstance(reply, str)
    return runner


def test_a_sensor_stays_on_its_grid() -> None:
    runner = sensor()
    assert runner.wait_s(10.0) == pytest.approx(T)
    assert not runner.due(10.0 + 0.99 * T)
    for tick in range(1, 100):
        now = 10.0 + tick * T + 0.001
        assert runner.due(now)
        (position,) = runner.tick(now)
        assert isinstance(position, Position)
        assert position.seq == tick - 1
        runner.settle(now + 0.002)
        assert runner.wait_s(now + 0.002) == pytest.approx(T - 0.003)
    assert runner.missed == 0


@pytest.mark.parametrize("points", [1, 2, 7])
def test_missed_grid_points_are_counted_and_skipped(points: int) -> None:
    runner = sensor()
    now = 10.0 + (1 + points) * T + 0.001
    runner.tick(now)
    runner.settle(now + 0.002)
    assert runner.missed == points
    assert not runner.due(now + 0.002)
    assert runner.wait_s(now + 0.002) == pytest.approx(T - 0.003)


def test_an_actuator_stays_on_its_grid_and_counts_no_missed_points() -> None:
    runner = Runner(ACTUATOR, RIG, Output())
    wake_s = runner.config.age.wake_s
    runner.begin(10.0)
    runner.call(Reset(acknowledge=True), 10.0)
    runner.call(Arm(1, 1, RIG.digest()), 10.0)
    assert runner.wait_s(10.0) == pytest.approx(wake_s)
    runner.tick(10.0 + 3.1 * wake_s)
    runner.settle(10.0 + 3.1 * wake_s)
    assert runner.missed == 0
    assert runner.wait_s(10.0 + 3.1 * wake_s) == pytest.approx(0.9 * wake_s)


class Watched(Output):
    def keep_alive(self) -> None:
        """Notifies no thread."""

    def clear_trip(self) -> None:
        """Do nothing: it has never tripped."""


@pytest.mark.parametrize(("output", "look_s"), [(Output(), SAMPLE_S), (Watched(), T)])
def test_an_actuator_at_rest_checks_its_clock_seldom_until_it_is_armed(
    output: Output, look_s: float
) -> None:
    runner = Runner(ACTUATOR, RIG, output)
    runner.begin(10.0)
    now = 10.0 + runner.wait_s(10.0)
    runner.tick(now)
    runner.settle(now)
    assert runner.wait_s(now) == pytest.approx(look_s)
    now += 0.3 * look_s
    runner.call(Reset(acknowledge=True), now)
    runner.call(Arm(1, 1, RIG.digest()), now)
    assert 0.0 < runner.wait_s(now) <= EARLY * runner.config.age.wake_s


def test_an_arming_with_another_model_changes_the_wake_up_interval() -> None:
    runner = Runner(ACTUATOR, RIG, Output())
    slower = Calibration(values={"model.natural_frequency_rad_per_s": 2000.0})
    runner.call(Reset(acknowledge=True), 10.0)
    answer, _ = runner.call(Arm(2, 7, runner.digest, Document(slower.text())), 10.0)
    assert answer == Ack(-1)
    assert runner.interval_s == pytest.approx(3.0 * pi / 2000.0)


def test_a_program_without_a_clock_waits_for_messages_or_for_a_partner() -> None:
    runner = estimator()
    assert runner.wait_s(10.0) == IDLE_S
    runner.take(POSITION, 10.0)
    assert runner.wait_s(10.001) == pytest.approx(0.25 * T - 0.001)
    assert not runner.due(1e9)


def test_in_lockstep_only_messages_cause_a_step() -> None:
    for service, device in ((SENSOR, Laser()), (ACTUATOR, Output())):
        runner = Runner(service, LOCKSTEP, device)
        runner.begin(10.0)
        assert runner.wait_s(10.0) == IDLE_S
        assert not runner.due(1e9)


def test_earlier_messages_are_counted_but_cause_no_step() -> None:
    runner = estimator()
    stepped: list[int] = []
    for seq in (0, 2, 1, 2, 3):
        runner.take(replace(APPLIED, seq=seq - 1), 10.1)
        runner.take(replace(POSITION, seq=seq), 10.1)
        while (outputs := runner.fire(10.1)) is not None:
            for message in outputs:
                assert isinstance(message, Estimate)
                stepped.append(message.seq)
    assert stepped == [0, 2, 3]
    status, _ = runner.call(StatusRequest(), 10.1)
    assert isinstance(status, Status)
    assert status.refused == 2


def test_messages_of_another_epoch_displace_no_valid_message() -> None:
    runner = estimator()
    runner.take(APPLIED, 10.0)
    messages = [POSITION, *(replace(POSITION, epoch=9 + n) for n in range(3))]
    for message in messages:
        runner.take(message, 10.0)
    received: list[Message] = []
    while (outputs := runner.fire(10.0 + T)) is not None:
        received += outputs
    assert [message.seq for message in received if isinstance(message, Estimate)] == [0]


def test_the_number_of_waiting_epochs_is_limited() -> None:
    runner = estimator()
    for epoch in range(2, 1000):
        runner.take(replace(POSITION, epoch=epoch), 10.0)
    steps = 0
    while runner.ready(10.0 + T):
        runner.fire(10.0 + T)
        steps += 1
    assert steps == KEPT
    assert runner.missed == 998 - KEPT


def test_a_sensor_that_samples_seldom_is_armed_within_a_period() -> None:
    runner = sensor()
    reply, _ = runner.call(Idle(0), 10.0)
    assert not isinstance(reply, str)
    now = 10.0 + T
    runner.tick(now)
    runner.settle(now)
    assert runner.wait_s(now) == pytest.approx(SAMPLE_S)
    now += 0.31 * SAMPLE_S
    reply, _ = runner.call(Arm(1, 1, RIG.digest()), now)
    assert not isinstance(reply, str)
    assert 0.0 < runner.wait_s(now) <= T
    due_s = now + runner.wait_s(now)
    assert (due_s - 10.0) / T == pytest.approx(round((due_s - 10.0) / T)), "it keeps its grid"
    (position,) = runner.tick(due_s)
    assert isinstance(position, Position)
    assert (position.epoch, position.seq) == (1, 0)
