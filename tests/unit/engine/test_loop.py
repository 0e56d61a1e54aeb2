"""Several services as one program: the order of steps, and when messages are sent."""

import threading
from dataclasses import dataclass, field
from math import inf
from time import monotonic
from typing import Any

import pytest
from msgspec.structs import replace

from pincette.bus.protocol import RequestHandler, Sink
from pincette.bus.refused import MANY, RefusedMessages
from pincette.config import ConfigError, read_rig
from pincette.core.messages import (
    Applied,
    Arm,
    Command,
    Estimate,
    Load,
    Message,
    Position,
    RequestLog,
    Reset,
    Status,
    StatusRequest,
    Telemetry,
    Timing,
)
from pincette.core.topics import ARM, COMMAND, LOAD, LOOP, RESET, STATUS, Request, Topic
from pincette.core.wording import fault_text
from pincette.engine.arming import ORDER
from pincette.engine.loop import Loop
from pincette.engine.process import loop_services
from pincette.engine.runner import Outputs, Runner
from pincette.engine.simulated import simulated_devices
from pincette.engine.timing_budget import PATIENCE_WAKES, shared_timeout_s
from pincette.engine.timing_stats import PUBLISH_EVERY_S
from tests.support.partitions import composing
from tests.support.rigs import DEMO, demo_rig
from tests.support.scripted import PROGRAM
from tests.unit.engine.instruments import Laser
from tests.unit.engine.samples import ESTIMATE, IDLE, POSITION

SERVICES = loop_services()
RIG = read_rig(DEMO)
LOCKSTEP = demo_rig(time="lockstep")
TICK = [Position, Estimate, Command, Telemetry, Applied]
T = RIG.rig.period_s


@dataclass
class Output:
    put_V: list[float] = field(default_factory=list[float])

    def write_V(self, voltage_V: float) -> None:
        self.put_V.append(voltage_V)

    def read_V(self) -> float:
        return 0.0

    def close(self) -> None:
        """Do nothing: there is no port to close."""


@dataclass
class Outside:
    """A bus that stores published messages and passes on requests."""

    told: list[Message] = field(default_factory=list[Message])
    sinks: dict[Topic, Sink] = field(default_factory=dict[Topic, Sink])
    answerers: dict[Request, RequestHandler] = field(default_factory=dict[Request, RequestHandler])

    def publish(self, message: Message) -> None:
        self.told.append(message)

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        self.sinks[topic] = sink

    def serve(self, question: Request, answerer: RequestHandler) -> None:
        self.answerers[question] = answerer

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        raise NotImplementedError((question, request, timeout_s))

    def close(self) -> None:
        """Do nothing: there is no connection to close."""


def in_lockstep(*names: str, urgent: tuple[Topic, ...] = ()) -> tuple[Loop, Outside]:
    """Return services on a simulated rig, in their state before a reset."""
    devices, outside = simulated_devices(LOCKSTEP, lambda _truth: None), Outside()
    runners = [Runner(SERVICES[name], LOCKSTEP, devices.get(name)) for name in names]
    return Loop(runners, outside, urgent=urgent), outside


def asked(
    loop: Loop, outside: Outside, question: Request, request: Message
) -> tuple[Message | str, list[Message]]:
    """Return the reply, and the messages that were sent before it."""
    replies: list[tuple[Message | str, list[Message]]] = []
    outside.answerers[question](
        question, request, lambda reply: replies.append((reply, list(outside.told)))
    )
    loop.run_once()
    return replies[0]


def armed(loop: Loop, outside: Outside) -> None:
    """Begin an epoch, and play its first tick."""
    asked(loop, outside, RESET, Reset(acknowledge=True))
    asked(loop, outside, LOAD, Load(PROGRAM))
    for name in ORDER:
        reply, _ = asked(loop, outside, ARM[name], Arm(1, 1, LOCKSTEP.digest()))
        assert not isinstance(reply, str), reply


def kinds(messages: list[Message]) -> list[type]:
    return [type(one) for one in messages]


def test_a_tick_of_a_composed_program_runs_its_services_in_order() -> None:
    loop, outside = in_lockstep(*LOOP)
    armed(loop, outside)
    for _ in range(3):
        outside.told.clear()
        loop.run_once()
        assert kinds(outside.told) == TICK
    assert outside.sinks == {}, "the program must not receive messages from outside"


def test_the_loop_computes_one_tick_at_a_time_so_that_requests_are_handled_between_ticks() -> None:
    loop, outside = in_lockstep(*LOOP)
    armed(loop, outside)
    outside.told.clear()
    reply, before = asked(loop, outside, STATUS["actuator"], StatusRequest())
    assert isinstance(reply, Status)
    assert before == [], "the reply must not wait for a tick"
    assert kinds(outside.told) == TICK


def test_each_service_of_a_composed_program_replies_to_its_own_requests() -> None:
    loop, outside = in_lockstep(*LOOP)
    for name in LOOP:
        reply, _ = asked(loop, outside, STATUS[name], StatusRequest())
        assert isinstance(reply, Status)
        assert reply.service == name
    assert len(outside.answerers) == sum(len(SERVICES[name].requests) for name in LOOP)


def test_the_outputs_of_a_request_are_sent_before_its_reply() -> None:
    loop, outside = in_lockstep(*LOOP)
    asked(loop, outside, RESET, Reset(acknowledge=True))
    outside.told.clear()
    _, before = asked(loop, outside, ARM["actuator"], Arm(1, 1, LOCKSTEP.digest()))
    assert kinds(before) == [Applied, RequestLog]


def test_outputs_that_other_programs_need_are_sent_at_once_and_others_at_the_end_of_the_tick() -> (
    None
):
    left: list[type] = []

    class Watched(Runner):
        def fire(self, now: float) -> Outputs | None:
            if self.ready(now):  # and not while it waits for a partner
                left.extend(kinds(outside.told))
                outside.told.clear()
            return super().fire(now)

    outside = Outside()
    runners = [Watched(SERVICES[name], RIG) for name in ("estimator", "controller")]
    loop = Loop(runners, outside, urgent=(COMMAND,))
    for sample in (IDLE, POSITION):
        next(sink for topic, sink in outside.sinks.items() if topic.message is type(sample))(
            COMMAND, sample
        )
    loop.run_once()
    assert left == []
    assert kinds(outside.told) == [Command, Estimate]


def test_the_actuator_receives_a_sample_before_the_other_services_compute() -> None:
    loop = Loop(
        [
            Runner(SERVICES[name], RIG, device)
            for name, device in (
                ("sensor", Laser()),
                ("actuator", Output()),
                ("estimator", None),
                ("controller", None),
            )
        ],
        Outside(),
    )
    loop.begin(10.0)
    sensor = loop.runner("sensor")
    assert sensor.due(10.0 + T)
    loop.share(sensor.tick(10.0 + T), 10.0 + T)
    now, stepped = 10.0 + 1.3 * T, list[str]()
    while (runner := next((one for one in loop.runners if one.ready(now)), None)) is not None:
        stepped.append(runner.service.name)
        loop.share(runner.fire(now) or (), now)
    assert stepped == ["actuator", "estimator", "controller", "actuator"]


def test_the_loop_waits_for_the_next_deadline() -> None:
    runners = [
        Runner(SERVICES["sensor"], RIG, Laser()),
        Runner(SERVICES["actuator"], RIG, Output()),
    ]
    loop = Loop(runners, Outside())
    loop.begin(10.0)
    wake_s = loop.runner("actuator").config.age.wake_s
    assert loop.wait_s(10.0) == pytest.approx(wake_s)
    assert loop.wait_s(10.0 + 0.9 * wake_s) == pytest.approx(0.1 * wake_s)


def test_the_timing_of_one_service_is_published_at_a_time() -> None:
    devices: dict[str, Laser | Output] = {"sensor": Laser(), "actuator": Output()}
    outside = Outside()
    loop = Loop([Runner(SERVICES[name], RIG, devices.get(name)) for name in LOOP], outside)
    loop.begin(monotonic() - 2.0 * PUBLISH_EVERY_S)
    received: list[str] = []
    for _ in LOOP:
        outside.told.clear()
        loop.run_once()
        (timing,) = [one for one in outside.told if isinstance(one, Timing)]
        received.append(timing.service)
    assert sorted(received) == sorted(LOOP)


@pytest.mark.parametrize("first", [7, 200], ids=["repeated", "ahead"])
def test_samples_of_another_program_become_a_finding_that_names_the_topic(first: int) -> None:
    """They have sequence numbers that were already used, or block the sensor's own samples."""
    bus, refused = Outside(), RefusedMessages("demo/estimator")
    sensor = Loop([Runner(SERVICES["sensor"], RIG, Laser())], bus)
    sensor.begin(monotonic() - 2.0 * T)
    sensor.run_once()
    (sample,) = [one for one in bus.told if isinstance(one, Position)]
    loop = Loop([Runner(SERVICES["estimator"], RIG)], Outside(), refused=refused)
    now_s = monotonic()
    loop.runner("estimator").joiner.begin(1, now_s)
    loop.deliver(replace(sample, epoch=1, seq=first), now_s)
    for seq in range(7 - MANY + 1, 7):
        loop.deliver(replace(sample, epoch=1, seq=seq), now_s)
        assert refused.finding() is None, "the bus may repeat or reorder a few samples"
    loop.deliver(replace(sample, epoch=1, seq=7), now_s)
    assert loop.runner("estimator").refused == MANY
    found = refused.finding()
    assert found is not None
    assert refused.count == 0, "the runner counts them"
    words = fault_text(found)
    assert all(part in words for part in ("another program", "position", "last was 7")), words


@pytest.mark.parametrize("where", ["fire", "settle"])
def test_a_service_that_fails_ends_the_program_with_its_instrument_at_rest(where: str) -> None:
    """The service fails in its step, or in work that it has deferred until its outputs are
    published."""

    def fails(*_given: Any) -> Any:
        raise ZeroDivisionError

    output, outside = Output(), Outside()
    runners = [Runner(SERVICES["controller"], RIG), Runner(SERVICES["actuator"], RIG, output)]
    loop = Loop(runners, outside)
    state = runners[1].state
    runners[1].state = replace(state, arms=(replace(state.arms[0], voltage_V=1.5),))
    failing: Any = runners[0]
    setattr(failing, where, fails)
    next(iter(outside.sinks.values()))(COMMAND, ESTIMATE)
    ended: list[BaseException] = []

    def run() -> None:
        try:
            loop.run()
        except ZeroDivisionError as error:
            ended.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(10.0)
    assert len(ended) == 1
    assert output.put_V[-1] == RIG.safety.safe_V
    assert output.put_V == sorted(output.put_V, reverse=True)
    assert len(output.put_V) > 3, "the voltage must ramp and not jump"


@pytest.mark.parametrize(
    ("names", "shared"),
    [(LOOP, True), (("sensor", "actuator"), True), (LOOP[:3], False), (LOOP[1:], False)],
)
def test_a_sensor_waits_briefly_only_in_a_program_that_contains_the_actuator(
    names: tuple[str, ...], shared: bool
) -> None:
    limit_s = shared_timeout_s(RIG, [SERVICES[name] for name in names])
    wake_s = Runner(SERVICES["actuator"], RIG, Output()).config.age.wake_s
    assert limit_s == (PATIENCE_WAKES * wake_s if shared else inf)
    assert shared_timeout_s(LOCKSTEP, SERVICES.values()) == inf


def test_a_sensor_too_slow_for_a_composed_loop_is_refused_with_both_times() -> None:
    slow = RIG.sensor.model_copy(update={"options": {**RIG.sensor.options, "baud": 9600}})
    rig = composing(RIG.model_copy(update={"sensor": slow}), "loop")
    with pytest.raises(ConfigError, match=r"'loop'.*takes \d+\.\d ms, limit 4\.6 ms"):
        shared_timeout_s(rig, SERVICES.values())


def test_a_sensor_that_would_always_be_slightly_too_late_is_refused_too() -> None:
    # Of 1.93 ms its line alone takes 1.8, and no reply came in time.
    rig = composing(demo_rig({"rig": {"period_s": 0.01}}), "loop")
    with pytest.raises(ConfigError, match=r"takes 1\.8 ms, limit 1\.5 ms in one program"):
        shared_timeout_s(rig, SERVICES.values())
