"""How punctual a service is said to be: by its turns, in virtual time."""

from dataclasses import replace
from pathlib import Path

import pytest

from pincette.config import read_rig
from pincette.messages import (
    Applied,
    Arm,
    Command,
    Estimate,
    Message,
    Position,
    Reset,
    Timing,
    TimingRequest,
)
from pincette.runtime.meter import KEPT, TOLD_EVERY_S, Meter
from pincette.runtime.node import Node
from pincette.runtime.turns import NO_CLOCK, Turns
from pincette_actuator import SERVICE as ACTUATOR
from pincette_controller import SERVICE as CONTROLLER
from pincette_estimator import SERVICE as ESTIMATOR
from pincette_sensor import SERVICE as SENSOR

RIG = read_rig(Path("deploy/rigs/demo.toml"))
LOCKSTEP = RIG.model_copy(update={"rig": RIG.rig.model_copy(update={"time": "lockstep"})})
T = RIG.rig.period_s
POSITION = Position(1, 0, 0.0, 1.0, True)
APPLIED = Applied(1, -1, 0.5, "armed", "", 0, False, False, False, True, 0, 0.0)
COMMAND = Command(1, 0, 7, 0.1, False, False, False, True)
ESTIMATE = Estimate(1, 0, 1.0, 0.0, 0.1, 0.0, 0.0, "", 0.0, -1, 0, False, False, True)


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


def timing(turns: Turns, now: float = 11.0) -> Timing:
    answer, outputs = turns.ask(TimingRequest(), now)
    assert isinstance(answer, Timing)
    assert outputs == ()
    return answer


def armed(turns: Turns, now: float = 10.0) -> Turns:
    turns.begin(now)
    turns.ask(Reset(acknowledge=True), now)
    reply, _ = turns.ask(Arm(1, turns.node.instance, RIG.digest()), now)
    assert not isinstance(reply, str)
    return turns


def fire_all(turns: Turns, now: float, took_s: float = 0.001) -> list[Message]:
    said: list[Message] = []
    while turns.node.due(now):
        said += turns.fire(now)
        now += took_s
        turns.told(now)
    return said


def test_a_sensor_is_late_against_its_own_grid_and_takes_as_long_as_it_takes() -> None:
    turns = armed(Turns(Node(SENSOR, RIG, Laser())))
    lates_s = (0.0, 0.001, 0.004)
    for tick, late_s in enumerate(lates_s, start=1):
        now = 10.0 + tick * T + late_s
        turns.take(now)
        turns.taken(now + 0.003)
    told = timing(turns)
    assert (told.service, told.epoch, told.seq, told.missed) == ("sensor", 1, 2, 0)
    assert told.lateness.count == told.execution.count == 3
    assert told.lateness.max_s == pytest.approx(0.004)
    assert told.execution.max_s == pytest.approx(0.003)
    assert told.age.count == 0


def test_points_that_a_sensor_missed_are_counted_from_the_arming_on() -> None:
    turns = Turns(Node(SENSOR, RIG, Laser()))
    turns.begin(10.0)
    turns.take(10.0 + 4 * T)
    turns.taken(10.0 + 4 * T)
    assert timing(turns).missed == 3
    armed(turns, 11.0)
    assert timing(turns) == Timing(1, -1, "sensor", 0, *[timing(turns).age] * 3)
    turns.take(11.0 + 3 * T)
    turns.taken(11.0 + 3 * T)
    assert timing(turns).missed == 2
    assert timing(turns).lateness.max_s == pytest.approx(2 * T)


def test_an_estimator_is_as_late_as_its_samples_and_their_wait_is_their_age() -> None:
    turns = armed(Turns(Node(ESTIMATOR, RIG)))
    for seq, wait_s in enumerate((0.0, 0.002, 0.001)):
        came_s = 10.0 + seq * T + (0.003 if seq == 1 else 0.0)
        turns.accept(replace(POSITION, seq=seq), came_s + 0.0005, came_s)
        turns.accept(replace(APPLIED, seq=seq - 1), came_s + wait_s)
        assert fire_all(turns, came_s + wait_s)
    told = timing(turns)
    assert told.seq == 2
    assert told.lateness.count == told.age.count == told.execution.count == 3
    assert told.lateness.max_s == pytest.approx(0.003)
    assert told.age.max_s == pytest.approx(0.002)
    assert told.execution.max_s == pytest.approx(0.001)


def test_a_controller_counts_estimates() -> None:
    turns = Turns(Node(CONTROLLER, RIG))
    turns.accept(replace(ESTIMATE, epoch=0), 10.004, 10.003)
    assert fire_all(turns, 10.004)
    assert timing(turns).age.max_s == pytest.approx(0.001)


def test_the_age_at_an_actuator_is_that_of_the_command_s_sample() -> None:
    turns = armed(Turns(Node(ACTUATOR, RIG, Output())))
    command = replace(COMMAND, owner=turns.node.instance)
    turns.accept(POSITION, 10.001, 10.0005)
    fire_all(turns, 10.001)
    assert timing(turns).age.count == 0
    turns.accept(command, 10.004, 10.0035)
    fire_all(turns, 10.004, 0.002)
    told = timing(turns)
    assert told.age.count == 1
    assert told.age.max_s == pytest.approx(0.0035)
    assert told.execution.count == 2
    assert told.execution.max_s == pytest.approx(0.002)
    assert told.lateness.count == 0
    due_s = turns.due_at
    assert due_s is not None
    turns.take(due_s + 0.0007)
    turns.taken(due_s + 0.0008)
    assert timing(turns).lateness.max_s == pytest.approx(0.0007)


def test_what_other_epochs_say_is_not_counted() -> None:
    turns = armed(Turns(Node(ESTIMATOR, RIG)))
    turns.accept(replace(POSITION, epoch=5), 10.0)
    fire_all(turns, 10.0 + T)
    told = timing(turns)
    assert told.lateness.count == told.age.count == 0


def test_an_arrival_that_is_long_past_is_not_taken_for_that_of_another_number() -> None:
    meter = Meter(ESTIMATOR, T, own_grid=False)
    meter.begin(1, 0)
    meter.came(POSITION, 10.0)
    meter.came(replace(POSITION, seq=KEPT), 10.0 + KEPT * T)
    meter.fired(POSITION, 20.0, ())
    assert meter.timing(0).age.count == 0


def test_in_lockstep_nothing_is_counted() -> None:
    turns = Turns(Node(ESTIMATOR, LOCKSTEP))
    turns.begin(10.0)
    assert turns.ask(TimingRequest(), 10.0) == (NO_CLOCK, ())
    assert turns.timing(1e9) == ()


def test_it_is_told_about_once_a_second() -> None:
    turns = armed(Turns(Node(ESTIMATOR, RIG)))
    told = [turns.timing(10.0 + 0.01 * look) for look in range(1000)]
    at = [look for look, outputs in enumerate(told) if outputs]
    assert len(at) == 9
    assert at[0] == pytest.approx(100 * TOLD_EVERY_S, abs=1)
