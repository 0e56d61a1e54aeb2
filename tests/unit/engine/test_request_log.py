"""A node tells which questions it has taken, and where among its steps."""

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
from pincette.engine.node import Node
from pincette.engine.replay.service_alone import Tape
from pincette.records.schemas import SCHEMAS
from pincette_actuator import SERVICE as ACTUATOR
from pincette_controller import SERVICE as CONTROLLER
from tests.support.rigs import demo_rig
from tests.unit.controller.bench import QUIET, program

RIG = demo_rig(time="lockstep")
PROGRAM = program()
ARM = Arm(3, 1, RIG.digest())


def asked(node: Node, question: Message) -> list[RequestLog]:
    _, outputs = node.call(question, 0.0)
    return [item for item in outputs if isinstance(item, RequestLog)]


def test_a_program_is_told_with_the_arming_that_plays_it() -> None:
    node = Node(CONTROLLER, RIG)
    assert asked(node, Load(PROGRAM)) == []
    load, arm = asked(node, ARM)
    assert (load.load, arm.arm) == (Load(PROGRAM), ARM)
    assert (load.epoch, arm.epoch, arm.seq, arm.topic) == (3, 3, -1, "")
    again, _ = asked(node, Arm(4, 1, RIG.digest()))
    assert (again.epoch, again.load) == (4, Load(PROGRAM))


def test_what_is_refused_or_changes_nothing_is_not_told() -> None:
    node = Node(CONTROLLER, RIG)
    assert asked(node, ARM) == []
    assert asked(node, Action(ActionCode.STOP)) == []
    assert asked(node, StatusRequest()) == []


def test_an_actuator_tells_of_trip_and_reset_and_of_the_voltage_it_brings() -> None:
    tape, found_V = Tape(), 1229 * RIG.output.step_V
    node = Node(ACTUATOR, RIG, tape)
    tape.found_V = found_V
    asked(node, Reset(acknowledge=True))
    node.state = (
        ACTUATOR.initialize_from_output(node.config, node.state, (found_V,))
        if ACTUATOR.initialize_from_output
        else None
    )
    (armed,) = asked(node, ARM)
    assert armed.state_snapshot == f'{{"arms":[{{"voltage_V":{found_V}}}]}}'
    (trip,) = asked(node, Trip(Cause.ESTOP))
    assert (trip.trip, trip.epoch, trip.seq) == (Trip(Cause.ESTOP), 3, -1)


def test_an_action_is_told_with_the_sample_after_which_it_came() -> None:
    node = Node(CONTROLLER, RIG)
    asked(node, Load(PROGRAM))
    asked(node, ARM)
    for seq in range(4):
        node.accept(replace(QUIET, epoch=3, seq=seq), 0.0)
        node.fire(0.0)
    (stop,) = asked(node, Action(ActionCode.STOP))
    assert (stop.action, stop.seq, stop.topic) == (Action(ActionCode.STOP), 3, "estimate")
    load, arm = asked(node, Arm(4, 1, RIG.digest()))
    assert (load.seq, arm.seq) == (-1, -1)
    node.accept(replace(QUIET, epoch=3, seq=4), 0.0)  # late, of the epoch before
    node.fire(0.0)
    (stop,) = asked(node, Action(ActionCode.STOP))
    assert (stop.epoch, stop.seq, stop.topic) == (4, -1, "")


def test_a_record_holds_a_program_whole() -> None:
    node = Node(CONTROLLER, RIG)
    asked(node, Load(PROGRAM))
    for item in asked(node, ARM):
        assert SCHEMAS["request_log"].unpack(SCHEMAS["request_log"].pack(item)) == item
