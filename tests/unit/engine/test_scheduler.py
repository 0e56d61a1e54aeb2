"""When a node steps: the sensor's grid, the actuator's wakings, and what is not handed over."""

from math import pi
from pathlib import Path

import pytest
from msgspec.structs import replace

from pincette.config import Calibration, read_rig
from pincette.control.quantities import Document
from pincette.core.faults import Cause, Mode
from pincette.core.idle_sampling import SAMPLE_S
from pincette.core.messages import (
    Ack,
    Applied,
    Arm,
    Estimate,
    Idle,
    Message,
    Position,
    Reset,
    Status,
    StatusRequest,
)
from pincette.engine.node import KEPT, Node
from pincette.engine.scheduler import IDLE_S, Task
from pincette_actuator import SERVICE as ACTUATOR
from pincette_estimator import SERVICE as ESTIMATOR
from pincette_sensor import SERVICE as SENSOR

RIG = read_rig(Path("deploy/rigs/demo.toml"))
LOCKSTEP = RIG.model_copy(update={"rig": RIG.rig.model_copy(update={"time": "lockstep"})})
T = RIG.rig.period_s
APPLIED = Applied(1, -1, 0.5, Mode.ARMED, Cause.NONE, 0, False, False, False, True, 0, 0.0)
POSITION = Position(1, 0, 0.0, 1.0, True)


class Laser:
    def read_um(self) -> float:
        return 1.0

    def close(self) -> None:
        """Nothing to give back."""


class Output:
    def write_V(self, voltage_V: float) -> None:
        """Moves nothing."""

    def read_V(self) -> float:
        return 0.0

    def close(self) -> None:
        """Nothing to give back."""


def sensor() -> Task:
    task = Task(Node(SENSOR, RIG, Laser()))
    task.begin(10.0)
    return task


def estimator(epoch: int = 1) -> Task:
    task = Task(Node(ESTIMATOR, RIG))
    task.begin(10.0)
    reply, _ = task.call(Arm(epoch, 1, RIG.digest()), 10.0)
    assert not isinstance(reply, str)
    return task


def test_a_sensor_keeps_to_its_grid() -> None:
    task = sensor()
    assert task.wait_s(10.0) == pytest.approx(T)
    assert not task.due(10.0 + 0.99 * T)
    for tick in range(1, 100):
        now = 10.0 + tick * T + 0.001
        assert task.due(now)
        (position,) = task.tick(now)
        assert isinstance(position, Position)
        assert position.seq == tick - 1
        task.finish_tick(now + 0.002)
        assert task.wait_s(now + 0.002) == pytest.approx(T - 0.003)
    assert task.node.missed == 0


@pytest.mark.parametrize("points", [1, 2, 7])
def test_missed_points_of_the_grid_are_counted_and_never_caught_up(points: int) -> None:
    task = sensor()
    now = 10.0 + (1 + points) * T + 0.001
    task.tick(now)
    task.finish_tick(now + 0.002)
    assert task.node.missed == points
    assert not task.due(now + 0.002)
    assert task.wait_s(now + 0.002) == pytest.approx(T - 0.003)


def test_an_actuator_keeps_its_grid_of_wakings_and_counts_no_missed_ones() -> None:
    task = Task(Node(ACTUATOR, RIG, Output()))
    wake_s = task.node.config.age.wake_s
    task.begin(10.0)
    task.call(Reset(acknowledge=True), 10.0)
    task.call(Arm(1, 1, RIG.digest()), 10.0)
    assert task.wait_s(10.0) == pytest.approx(wake_s)
    task.tick(10.0 + 3.1 * wake_s)
    task.finish_tick(10.0 + 3.1 * wake_s)
    assert task.node.missed == 0
    assert task.wait_s(10.0 + 3.1 * wake_s) == pytest.approx(0.9 * wake_s)


def test_an_arming_with_another_model_moves_the_wakings() -> None:
    node = Node(ACTUATOR, RIG, Output())
    task = Task(node)
    slower = Calibration(values={"model.natural_frequency_rad_per_s": 2000.0})
    task.call(Reset(acknowledge=True), 10.0)
    answer, _ = task.call(Arm(2, 7, node.digest, Document(slower.text())), 10.0)
    assert answer == Ack(-1)
    assert task.interval_s == pytest.approx(3.0 * pi / 2000.0)


def test_a_program_without_a_clock_waits_for_messages_or_for_a_partner() -> None:
    task = estimator()
    assert task.wait_s(10.0) == IDLE_S
    task.accept(POSITION, 10.0)
    assert task.wait_s(10.001) == pytest.approx(0.25 * T - 0.001)
    assert not task.due(1e9)


def test_in_lockstep_nothing_asks_for_a_step_but_messages() -> None:
    for service, device in ((SENSOR, Laser()), (ACTUATOR, Output())):
        task = Task(Node(service, LOCKSTEP, device))
        task.begin(10.0)
        assert task.wait_s(10.0) == IDLE_S
        assert not task.due(1e9)


def test_what_came_before_is_counted_and_not_stepped_with() -> None:
    task = estimator()
    stepped: list[int] = []
    for seq in (0, 2, 1, 2, 3):
        task.accept(replace(APPLIED, seq=seq - 1), 10.1)
        task.accept(replace(POSITION, seq=seq), 10.1)
        while task.node.due(10.1):
            for message in task.node.fire(10.1):
                assert isinstance(message, Estimate)
                stepped.append(message.seq)
    assert stepped == [0, 2, 3]
    status, _ = task.call(StatusRequest(), 10.1)
    assert isinstance(status, Status)
    assert status.refused == 2


def test_what_another_epoch_says_does_not_push_out_what_counts() -> None:
    task = estimator()
    task.accept(APPLIED, 10.0)
    messages = [POSITION, *(replace(POSITION, epoch=9 + n) for n in range(3))]
    for message in messages:
        task.accept(message, 10.0)
    said: list[Message] = []
    while task.node.due(10.0 + T):
        said += task.node.fire(10.0 + T)
    assert [message.seq for message in said if isinstance(message, Estimate)] == [0]


def test_streams_that_wait_are_bounded() -> None:
    task = estimator()
    for epoch in range(2, 1000):
        task.accept(replace(POSITION, epoch=epoch), 10.0)
    steps = 0
    while task.node.due(10.0 + T):
        task.node.fire(10.0 + T)
        steps += 1
    assert steps == KEPT
    assert task.node.missed == 998 - KEPT


def test_a_sensor_that_samples_seldom_is_armed_within_a_period() -> None:
    task = sensor()
    reply, _ = task.call(Idle(0), 10.0)
    assert not isinstance(reply, str)
    now = 10.0 + T
    task.tick(now)
    task.finish_tick(now)
    assert task.wait_s(now) == pytest.approx(SAMPLE_S)
    now += 0.31 * SAMPLE_S
    reply, _ = task.call(Arm(1, 1, RIG.digest()), now)
    assert not isinstance(reply, str)
    assert 0.0 < task.wait_s(now) <= T
    due_s = now + task.wait_s(now)
    assert (due_s - 10.0) / T == pytest.approx(round((due_s - 10.0) / T)), "it keeps its grid"
    (position,) = task.tick(due_s)
    assert isinstance(position, Position)
    assert (position.epoch, position.seq) == (1, 0)
