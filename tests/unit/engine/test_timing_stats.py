"""Timing of a service as reported by its runner, in virtual time."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from pincette.config import read_rig
from pincette.core.messages import (
    Arm,
    Command,
    Message,
    Reset,
    Timing,
    TimingRequest,
)
from pincette.core.messages.arms import ArmCommand
from pincette.engine.runner import NO_CLOCK, Runner
from pincette.engine.timing_stats import KEPT, PUBLISH_EVERY_S, TimingStats
from pincette_actuator import SERVICE as ACTUATOR
from pincette_controller import SERVICE as CONTROLLER
from pincette_estimator import SERVICE as ESTIMATOR
from pincette_sensor import SERVICE as SENSOR
from tests.unit.engine import samples
from tests.unit.engine.instruments import Laser, Output
from tests.unit.engine.samples import ARMED as APPLIED

RIG = read_rig(Path("deploy/rigs/demo.toml"))
LOCKSTEP = RIG.model_copy(update={"rig": RIG.rig.model_copy(update={"time": "lockstep"})})
T = RIG.rig.period_s
POSITION = replace(samples.POSITION, epoch=1)

COMMAND = Command(1, 0, 7, (ArmCommand(0.1),), False, False, False, True)
ESTIMATE = replace(samples.ESTIMATE, epoch=1)


def timing(runner: Runner, now: float = 11.0) -> Timing:
    answer, outputs = runner.call(TimingRequest(), now)
    assert isinstance(answer, Timing)
    assert outputs == ()
    return answer


def armed(runner: Runner, now: float = 10.0) -> Runner:
    runner.begin(now)
    runner.call(Reset(acknowledge=True), now)
    reply, _ = runner.call(Arm(1, runner.instance, RIG.digest()), now)
    assert not isinstance(reply, str)
    return runner


def fire_all(runner: Runner, now: float, took_s: float = 0.001) -> list[Message]:
    received: list[Message] = []
    while (outputs := runner.fire(now)) is not None:
        received += outputs
        now += took_s
        runner.settle(now)
    return received


def test_a_sensor_is_late_relative_to_its_own_grid_and_its_duration_is_measured() -> None:
    runner = armed(Runner(SENSOR, RIG, Laser()))
    lates_s = (0.0, 0.001, 0.004)
    for tick, late_s in enumerate(lates_s, start=1):
        now = 10.0 + tick * T + late_s
        runner.tick(now)
        runner.settle(now + 0.003)
    reported = timing(runner)
    assert (reported.service, reported.epoch, reported.seq, reported.missed) == ("sensor", 1, 2, 0)
    assert reported.lateness.count == reported.execution.count == 3
    assert reported.lateness.max_s == pytest.approx(0.004)
    assert reported.execution.max_s == pytest.approx(0.003)
    assert reported.age.count == 0


def test_missed_grid_points_of_a_sensor_are_counted_since_the_arming() -> None:
    runner = Runner(SENSOR, RIG, Laser())
    runner.begin(10.0)
    runner.tick(10.0 + 4 * T)
    runner.settle(10.0 + 4 * T)
    assert timing(runner).missed == 3
    armed(runner, 11.0)
    assert timing(runner) == Timing(1, -1, "sensor", 0, *[timing(runner).age] * 3)
    runner.tick(11.0 + 3 * T)
    runner.settle(11.0 + 3 * T)
    assert timing(runner).missed == 2
    assert timing(runner).lateness.max_s == pytest.approx(2 * T)


def test_the_lateness_of_an_estimator_is_that_of_its_samples_and_their_age_includes_the_wait() -> (
    None
):
    runner = armed(Runner(ESTIMATOR, RIG))
    for seq, wait_s in enumerate((0.0, 0.002, 0.001)):
        came_s = 10.0 + seq * T + (0.003 if seq == 1 else 0.0)
        runner.take(replace(POSITION, seq=seq), came_s + 0.0005, came_s)
        runner.take(replace(APPLIED, seq=seq - 1), came_s + wait_s)
        assert fire_all(runner, came_s + wait_s)
    reported = timing(runner)
    assert reported.seq == 2
    assert reported.lateness.count == reported.age.count == reported.execution.count == 3
    assert reported.lateness.max_s == pytest.approx(0.003)
    assert reported.age.max_s == pytest.approx(0.002)
    assert reported.execution.max_s == pytest.approx(0.001)


def test_the_timing_of_a_controller_counts_estimates() -> None:
    runner = Runner(CONTROLLER, RIG)
    runner.take(replace(ESTIMATE, epoch=0), 10.004, 10.003)
    assert fire_all(runner, 10.004)
    assert timing(runner).age.max_s == pytest.approx(0.001)


def test_the_age_at_an_actuator_is_measured_from_the_sample_of_the_command() -> None:
    runner = armed(Runner(ACTUATOR, RIG, Output()))
    command = replace(COMMAND, owner=runner.instance)
    runner.take(POSITION, 10.001, 10.0005)
    fire_all(runner, 10.001)
    assert timing(runner).age.count == 0
    runner.take(command, 10.004, 10.0035)
    fire_all(runner, 10.004, 0.002)
    reported = timing(runner)
    assert reported.age.count == 1
    assert reported.age.max_s == pytest.approx(0.0035)
    assert reported.execution.count == 2
    assert reported.execution.max_s == pytest.approx(0.002)
    assert reported.lateness.count == 0
    due_s = runner.due_at
    assert due_s is not None
    runner.tick(due_s + 0.0007)
    runner.settle(due_s + 0.0008)
    assert timing(runner).lateness.max_s == pytest.approx(0.0007)


def test_messages_of_other_epochs_are_not_counted() -> None:
    runner = armed(Runner(ESTIMATOR, RIG))
    runner.take(replace(POSITION, epoch=5), 10.0)
    fire_all(runner, 10.0 + T)
    reported = timing(runner)
    assert reported.lateness.count == reported.age.count == 0


def test_an_old_arrival_time_is_not_used_for_a_later_sequence_number() -> None:
    meter = TimingStats(ESTIMATOR, T, own_grid=False)
    meter.begin(1, 0)
    meter.came(POSITION, 10.0)
    meter.came(replace(POSITION, seq=KEPT), 10.0 + KEPT * T)
    meter.fired(POSITION, 20.0, ())
    assert meter.timing(0).age.count == 0


def test_in_lockstep_no_timing_is_counted() -> None:
    runner = Runner(ESTIMATOR, LOCKSTEP)
    runner.begin(10.0)
    assert runner.call(TimingRequest(), 10.0) == (NO_CLOCK, ())
    assert runner.timing(1e9) == ()


def test_timing_is_published_about_once_a_second() -> None:
    runner = armed(Runner(ESTIMATOR, RIG))
    reported = [runner.timing(10.0 + 0.01 * look) for look in range(1000)]
    at = [look for look, outputs in enumerate(reported) if outputs]
    assert len(at) == 9
    assert at[0] == pytest.approx(100 * PUBLISH_EVERY_S, abs=1)
