"""A runner logs which requests it has accepted, and between which steps."""

from msgspec.structs import replace

from pincette.core.faults import ActionCode, Cause
from pincette.core.messages import (
    Action,
    Arm,
    Load,
    Message,
    RequestLog,
    Reset,
    StatusRequest,
    Trip,
)
from pincette.engine.replay.service_alone import Tape
from pincette.engine.runner import Runner
from pincette.records.schemas import SCHEMAS
from pincette_actuator import SERVICE as ACTUATOR
from pincette_controller import SERVICE as CONTROLLER
from tests.support.rigs import demo_rig
from tests.unit.controller.bench import QUIET, program

RIG = demo_rig(time="lockstep")
PROGRAM = program()
ARM = Arm(3, 1, RIG.digest())


def asked(runner: Runner, question: Message) -> list[RequestLog]:
    _, outputs = runner.call(question, 0.0)
    return [item for item in outputs if isinstance(item, RequestLog)]


def test_a_program_is_reported_with_the_arming_that_plays_it() -> None:
    runner = Runner(CONTROLLER, RIG)
    assert asked(runner, Load(PROGRAM)) == []
    load, arm = asked(runner, ARM)
    assert (load.load, arm.arm) == (Load(PROGRAM), ARM)
    assert (load.epoch, arm.epoch, arm.seq, arm.topic) == (3, 3, -1, "")
    again, _ = asked(runner, Arm(4, 1, RIG.digest()))
    assert (again.epoch, again.load) == (4, Load(PROGRAM))


def test_refused_requests_and_those_without_effect_are_not_logged() -> None:
    runner = Runner(CONTROLLER, RIG)
    assert asked(runner, ARM) == []
    assert asked(runner, Action(ActionCode.STOP)) == []
    assert asked(runner, StatusRequest()) == []


def test_an_actuator_logs_trip_and_reset_with_the_voltage() -> None:
    tape, found_V = Tape(), 1229 * RIG.output.step_V
    runner = Runner(ACTUATOR, RIG, tape)
    tape.found_V = found_V
    asked(runner, Reset(acknowledge=True))
    runner.state = (
        ACTUATOR.initialize_from_output(runner.config, runner.state, (found_V,))
        if ACTUATOR.initialize_from_output
        else None
    )
    (armed,) = asked(runner, ARM)
    assert armed.state_snapshot == f'{{"arms":[{{"voltage_V":{found_V}}}]}}'
    (trip,) = asked(runner, Trip(Cause.ESTOP))
    assert (trip.trip, trip.epoch, trip.seq) == (Trip(Cause.ESTOP), 3, -1)


def test_an_action_is_logged_with_the_sample_after_which_it_arrived() -> None:
    runner = Runner(CONTROLLER, RIG)
    asked(runner, Load(PROGRAM))
    asked(runner, ARM)
    for seq in range(4):
        runner.take(replace(QUIET, epoch=3, seq=seq), 0.0)
        runner.fire(0.0)
    (stop,) = asked(runner, Action(ActionCode.STOP))
    assert (stop.action, stop.seq, stop.topic) == (Action(ActionCode.STOP), 3, "estimate")
    load, arm = asked(runner, Arm(4, 1, RIG.digest()))
    assert (load.seq, arm.seq) == (-1, -1)
    runner.take(replace(QUIET, epoch=3, seq=4), 0.0)  # late, of the epoch before
    runner.fire(0.0)
    (stop,) = asked(runner, Action(ActionCode.STOP))
    assert (stop.epoch, stop.seq, stop.topic) == (4, -1, "")


def test_a_record_contains_a_complete_program() -> None:
    runner = Runner(CONTROLLER, RIG)
    asked(runner, Load(PROGRAM))
    for item in asked(runner, ARM):
        assert SCHEMAS["request_log"].unpack(SCHEMAS["request_log"].pack(item)) == item
