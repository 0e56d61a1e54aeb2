"""Joins of messages by sequence number, in both kinds of time."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import pytest

from pincette.config import Calibration, RigFile, calibrated, read_rig
from pincette.control.planning.sweep import Sweep
from pincette.control.quantities import Document
from pincette.control.record import replace
from pincette.core.faults import Cause, FaultCode
from pincette.core.messages import (
    Ack,
    Applied,
    Arm,
    Burst,
    Command,
    Message,
    Position,
    Reset,
    Status,
    StatusRequest,
    Trip,
)
from pincette.core.messages.arms import ArmCommand, ArmPosition
from pincette.core.service import Input, Service, SetVoltage
from pincette.core.topics import APPLIED, ESTIMATE, POSITION
from pincette.core.wording import applied_text, fault_text
from pincette.engine.runner import Runner
from pincette.instruments.protocols import Block, InstrumentError
from pincette_actuator import SERVICE as ACTUATOR
from pincette_estimator import SERVICE as ESTIMATOR
from pincette_sensor import SERVICE as SENSOR
from tests.unit.engine.samples import ARMED

RIG = read_rig(Path("deploy/rigs/demo.toml"))
LOCKSTEP = RIG.model_copy(update={"rig": RIG.rig.model_copy(update={"time": "lockstep"})})
APPLIED_0 = replace(ARMED, seq=0)


class Inputs(NamedTuple):
    position: Position | None
    applied: Applied | None


@dataclass(frozen=True)
class State:
    seen: tuple[tuple[Inputs, float], ...] = ()
    epoch: int = 0


def step(
    _config: None, state: State, inputs: Inputs, now: float
) -> tuple[State, tuple[Message | SetVoltage, ...]]:
    return replace(state, seen=(*state.seen, (inputs, now))), ()


def handle(
    _config: None, state: State, request: Message, _now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    assert isinstance(request, Arm)
    return replace(state, epoch=request.epoch), Ack(0), ()


def joining(rig: RigFile) -> Runner:
    service: Service[RigFile, None, State, Inputs] = Service(
        name="joiner",
        summary="keeps what it gets",
        inputs=(Input(POSITION, "trigger"), Input(APPLIED, "join", offset=-1)),
        outputs=(ESTIMATE,),
        requests=(),
        inputs_type=Inputs,
        configure=lambda _rig: None,
        start=lambda _config: State(),
        step=step,
        handle=handle,
    )
    return Runner(service, rig)


def position(seq: int, epoch: int = 1) -> Position:
    return Position(epoch, seq, 0.0, (ArmPosition(1.0, valid=True),))


@pytest.mark.parametrize("rig", [RIG, LOCKSTEP])
@pytest.mark.parametrize("applied_first", [True, False])
def test_sample_k_is_processed_together_with_the_applied_voltage_of_tick_k_minus_one(
    rig: RigFile, applied_first: bool
) -> None:
    runner = joining(rig)
    messages: list[Message] = [APPLIED_0, position(1)]
    for message in messages if applied_first else reversed(messages):
        runner.take(message, 0.0)
    assert runner.ready(0.0)
    runner.fire(0.0)
    assert runner.state.seen[0][0] == Inputs(position(1), APPLIED_0)


def test_messages_of_other_sequence_numbers_or_epochs_are_not_joined() -> None:
    runner = joining(LOCKSTEP)
    runner.take(replace(APPLIED_0, seq=1), 0.0)
    runner.take(replace(APPLIED_0, epoch=2), 0.0)
    runner.take(position(1), 0.0)
    assert not runner.ready(1e9)


def test_in_real_time_a_missing_partner_is_awaited_for_a_quarter_period() -> None:
    runner = joining(RIG)
    runner.take(position(1), 0.0)
    assert not runner.ready(0.0049)
    assert runner.wait_s(0.001) == pytest.approx(0.004)
    assert runner.ready(0.005)
    runner.fire(0.005)
    assert runner.state.seen == ((Inputs(position(1), None), 0.005),)


def test_in_real_time_a_backlog_is_skipped() -> None:
    runner = joining(RIG)
    for seq in range(300):
        runner.take(replace(APPLIED_0, seq=seq - 1), 10.0)
        runner.take(position(seq), 10.0)
    while runner.ready(10.0):
        runner.fire(10.0)
    assert [inputs.position for inputs, _ in runner.state.seen] == [position(299)]
    assert runner.missed == 299


def test_a_repeated_sample_does_not_displace_a_waiting_sample() -> None:
    runner = joining(RIG)
    for seq in (5, 0, 5):
        runner.take(position(seq), 10.0)
    runner.take(replace(APPLIED_0, seq=4), 10.0)
    runner.fire(10.0)
    assert [inputs.position for inputs, _ in runner.state.seen] == [position(5)]
    assert (runner.missed, runner.refused) == (0, 2)


def test_lockstep_answers_every_tick_in_virtual_time() -> None:
    runner = joining(LOCKSTEP)
    for seq in range(3):
        runner.take(replace(APPLIED_0, seq=seq - 1), 77.0)
        runner.take(position(seq), 77.0)
    while runner.ready(77.0):
        runner.fire(77.0)
    assert [now for _, now in runner.state.seen] == pytest.approx([0.0, 0.02, 0.04])


def test_arming_is_refused_with_another_rig_file() -> None:
    reply, _ = joining(RIG).call(Arm(1, 1, "0000"), 0.0)
    assert isinstance(reply, str)
    assert RIG.digest() in reply


def test_status_reports_epoch_digest_and_instance() -> None:
    runner = joining(RIG)
    runner.call(Arm(9, 1, RIG.digest()), 0.0)
    reply, _ = runner.call(StatusRequest(), 0.0)
    assert isinstance(reply, Status)
    assert (reply.epoch, reply.digest, reply.instance) == (9, RIG.digest(), 1)


class BrokenSensor:
    def read_um(self) -> float:
        raise InstrumentError("laser off")

    def close(self) -> None:
        """Do nothing: there is no port to close."""


def test_a_failing_sensor_gives_an_invalid_sample_with_the_reason() -> None:

    runner = Runner(SENSOR, RIG, BrokenSensor())
    (sample,) = runner.tick(1.0)
    assert isinstance(sample, Position)
    assert (sample.arms[0].valid, fault_text(sample.arms[0].fault), sample.seq) == (
        False,
        "laser off",
        0,
    )


def test_an_arming_sets_the_model_of_the_service() -> None:
    runner = Runner(ESTIMATOR, RIG)
    found = Calibration(values={"model.compliance_um_per_mN": 0.5})
    before = runner.config
    reply, _ = runner.call(Arm(2, 1, RIG.digest(), Document(found.text())), 0.0)
    assert reply == Ack(0)
    assert runner.config == ESTIMATOR.configure(calibrated(RIG, found)) != before
    status, _ = runner.call(StatusRequest(), 0.0)
    assert isinstance(status, Status)
    assert status.calibration == found.digest
    runner.call(Arm(3, 1, RIG.digest()), 0.0)
    assert runner.config == before


def test_an_impossible_model_refuses_the_arming_and_changes_nothing() -> None:
    runner = Runner(ESTIMATOR, RIG)
    before = runner.config
    reply, _ = runner.call(
        Arm(2, 1, RIG.digest(), Document('{"values": {"model.damping_ratio": -1}}')), 0.0
    )
    assert isinstance(reply, str)
    assert "estimator" in reply
    assert "model.damping_ratio = -1" in reply
    assert (runner.config, runner.state.epoch) == (before, 0)


class Buffered:
    """A sensor whose buffer holds three more samples at each reading."""

    def __init__(self) -> None:
        self.rates: list[float] = []

    def read_um(self) -> float:
        return 1.0

    def begin_capture(self, rate_hz: float) -> None:
        self.rates.append(rate_hz)

    def read_block(self) -> Block:
        return Block((2.0, 3.0, 4.0), (0.1, 0.2, 0.3))

    def end_capture(self) -> None:
        self.rates.append(0.0)

    def close(self) -> None:
        """Do nothing: there is no port to close."""


def test_an_acquisition_ends_with_the_arming_that_requested_it() -> None:
    sensor = Buffered()
    runner = Runner(SENSOR, RIG, sensor)
    runner.call(Arm(1, 1, RIG.digest(), capture_hz=150.0), 0.0)
    position, burst = runner.tick(0.0)
    assert isinstance(position, Position)
    assert position.arms[0].x_um == 4.0
    assert burst == Burst(1, 0, 150.0, (2.0, 3.0, 4.0), (0.1, 0.2, 0.3), True)
    runner.call(Arm(2, 1, RIG.digest()), 0.0)
    (single,) = runner.tick(0.02)
    assert isinstance(single, Position)
    assert single.arms[0].x_um == 1.0
    assert sensor.rates == [0.0, 150.0, 0.0]


def test_a_sensor_without_a_buffer_refuses_to_acquire() -> None:
    reply, _ = Runner(SENSOR, RIG, BrokenSensor()).call(
        Arm(1, 1, RIG.digest(), capture_hz=1e4), 0.0
    )
    assert reply == "the position sensor has no buffered acquisition"


class PlainOutput:
    """An output without a buffer."""

    def __init__(self) -> None:
        self.put_V: list[float] = []

    def write_V(self, voltage_V: float) -> None:
        self.put_V.append(voltage_V)

    def read_V(self) -> float:
        return 0.0

    def close(self) -> None:
        """Do nothing: there is no port to close."""


class PartsOutput(PlainOutput):
    """An output that times the parts of a step itself, and may fail."""

    def __init__(self) -> None:
        super().__init__()
        self.parts_V: list[tuple[float, ...]] = []
        self.broken = False

    def write_V(self, voltage_V: float) -> None:
        if self.broken:
            raise InstrumentError("no answer", "silent")
        super().write_V(voltage_V)

    def write_parts(self, voltages_V: Sequence[float], interval_s: float) -> None:
        assert interval_s == SHAPED.shaping_s
        self.parts_V.append(tuple(voltages_V))


SHAPED = RIG.model_copy(update={"output": RIG.output.model_copy(update={"shaping": True})})


def stepping(output: PlainOutput) -> tuple[Runner, Message]:
    """Return an actuator that has begun a step with a part held."""
    runner = Runner(ACTUATOR, SHAPED, output, check_timing=False)
    runner.call(Reset(acknowledge=True), 0.0)
    assert runner.call(Arm(1, 1, SHAPED.digest()), 0.0)[0] == Ack(-1)
    runner.take(position(0), 0.0)
    runner.fire(0.0)
    runner.take(Command(1, 0, 1, (ArmCommand(0.1),), True, False, False, True), 0.0)
    outputs = runner.fire(0.001)
    assert outputs is not None
    (applied,) = outputs
    return runner, applied


def test_a_shaped_step_is_passed_to_an_output_that_times_its_parts() -> None:
    output = PartsOutput()
    _, applied = stepping(output)
    assert isinstance(applied, Applied)
    assert len(output.parts_V) == 1
    assert output.parts_V[0][-1] == applied.arms[0].voltage_V > 0.0
    assert output.put_V == []


@pytest.mark.parametrize("broken", [False, True])
def test_a_stop_between_two_parts_is_written_at_once(*, broken: bool) -> None:
    output = PartsOutput()
    runner, _ = stepping(output)
    output.broken = broken
    _, published = runner.call(Trip(Cause.ESTOP), 0.0015)
    applied = [one for one in published if isinstance(one, Applied)][-1]
    assert applied.state == "frozen"
    if broken:
        assert applied.arms[0].voltage_V == output.read_V()
        assert any(one.code is FaultCode.OUTPUT_UNCONFIRMED for one in applied.faults)
    else:
        assert output.put_V == [output.parts_V[0][0]] == [applied.arms[0].voltage_V]


def test_an_output_without_shaping_trips_on_a_shaped_step() -> None:
    _, applied = stepping(PlainOutput())
    assert isinstance(applied, Applied)
    assert (applied.state, applied.cause) == ("frozen", Cause.DEVICE)


def test_an_output_without_a_buffer_trips_on_a_wave() -> None:
    output = PlainOutput()
    runner = Runner(ACTUATOR, RIG, output)
    runner.call(Reset(acknowledge=True), 0.0)
    assert runner.call(Arm(1, 1, RIG.digest()), 0.0)[0] == Ack(-1)
    runner.take(position(0), 0.0)
    runner.fire(0.0)
    sweep = Sweep(5.0, 400.0, 1.0, 0.05, 4_000.0)
    runner.take(Command(1, 0, 1, (ArmCommand(0.0),), False, False, False, True, sweep=sweep), 0.0)
    outputs = runner.fire(0.001)
    assert outputs is not None
    (applied,) = outputs
    assert isinstance(applied, Applied)
    assert (applied.state, applied.answered) == ("latched", False)
    assert "cannot play waves" in applied_text(applied)
    assert output.put_V == [], "the output is at the safe voltage, as it reports"
