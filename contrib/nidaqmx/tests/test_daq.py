"""The simulated NI device, call by call."""

import random
from typing import Any

import pytest
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx.constants import AcquisitionType, FillMode
from session_pb2 import Session

from contrib.support.wired_rig import DRIVE, OUTPUT, POSITION, WIRED, HandRig
from pincette_nidaqmx.simulated.daq import AVAILABLE, SERVICE, SimulatedDaq

SEED = 9263
CALLS = 20_000
BUFFER = {"ai": 0x186C, "ao": 0x186D}
FINITE, CONTINUOUS = AcquisitionType.FINITE.value, AcquisitionType.CONTINUOUS.value
LIMITS = {"min_val": -10.0, "max_val": 10.0}


class Caller:
    """Call a device, and distinguish a message from a refusal."""

    def __init__(self, x_um: float = 12.5, *, lockstep: bool = True) -> None:
        self.rig = HandRig(lambda: x_um)
        self.daq = SimulatedDaq(self.rig, WIRED, lockstep=lockstep)

    def said(self, name: str, **fields: Any) -> bytes:
        request: Any = getattr(messages, f"{name}Request")(**fields)
        reply = self.daq.answer(SERVICE + name.encode() + b"\0" + request.SerializeToString())
        assert reply is not None
        return reply

    def __call__(self, name: str, **fields: Any) -> Any:
        kind, _, rest = self.said(name, **fields).partition(b"\0")
        assert kind == b"ok", rest
        return getattr(messages, f"{name}Response").FromString(rest)

    def refused(self, name: str, **fields: Any) -> int:
        kind, code, text = self.said(name, **fields).split(b"\0", 2)
        assert kind == b"ni-error"
        assert text
        return int(code)

    def task(self, *channels: str, name: str = "") -> Session:
        made = self("CreateTask", session_name=name).task
        for channel in channels:
            kind = "AO" if "/ao" in channel else "AI"
            self(f"Create{kind}VoltageChan", task=made, physical_channel=channel, **LIMITS)
        return made

    def clocked(self, *channels: str, rate_hz: float, mode: int, count: int) -> Session:
        task = self.task(*channels)
        fields = {"rate": rate_hz, "sample_mode_raw": mode, "samps_per_chan": count}
        self("CfgSampClkTiming", task=task, **fields)
        return task


def test_a_position_is_read_in_steps_of_16_bit() -> None:
    call = Caller(12.3456)
    reply = call("ReadAnalogScalarF64", task=call.task(POSITION), timeout=1.0)
    codes = reply.value / (20.0 / 65536)
    assert codes == round(codes)
    assert 10.0 * reply.value == pytest.approx(12.3456, abs=0.5 * 10.0 * 20.0 / 65536)


@pytest.mark.parametrize(("x_um", "voltage_V"), [(1e12, 10.0), (-1e12, -10.0)])
def test_a_value_beyond_the_range_is_clamped(x_um: float, voltage_V: float) -> None:
    call = Caller(x_um)
    assert call("ReadAnalogScalarF64", task=call.task(POSITION)).value == voltage_V


@pytest.mark.parametrize(
    ("channel", "kind", "code"),
    [
        ("cDAQ9Mod1/ai0", "AI", -200220),
        ("cDAQ1Mod1/ai7", "AI", -200170),
        (OUTPUT, "AI", -200170),
        (POSITION, "AO", -200170),
    ],
)
def test_an_unconnected_channel_is_refused(channel: str, kind: str, code: int) -> None:
    call = Caller()
    task = call.task()
    name = f"Create{kind}VoltageChan"
    assert call.refused(name, task=task, physical_channel=channel, **LIMITS) == code


def test_impossible_ranges_rates_and_tasks_are_refused() -> None:
    call = Caller()
    task = call.task()
    wide = {"physical_channel": POSITION, "min_val": -20.0, "max_val": 20.0}
    assert call.refused("CreateAIVoltageChan", task=task, **wide) == -200077
    assert call.refused("StartTask", task=task) == -200478
    assert call.refused("StartTask", task=Session(id=99)) == -200088
    input_task = call.task(POSITION)
    assert call.refused("CfgSampClkTiming", task=input_task, rate=1e6, samps_per_chan=9) == -200077
    again = {"physical_channel": POSITION, **LIMITS}
    assert call.refused("CreateAIVoltageChan", task=input_task, **again) == -200489


def test_the_inputs_or_outputs_of_a_device_belong_to_one_task_at_a_time() -> None:
    call = Caller()
    first, second = call.task(POSITION), call.task(DRIVE)
    call("StartTask", task=first)
    call("StartTask", task=call.task(OUTPUT))
    assert call.refused("StartTask", task=second) == -50103
    call("StopTask", task=first)
    call("StartTask", task=second)
    call("ClearTask", task=second)
    assert call.refused("StopTask", task=second) == -200088
    call("StartTask", task=first)


def test_voltages_are_quantized_to_16_bit() -> None:
    call = Caller()
    task = call.task(OUTPUT)
    refused = call.refused("WriteAnalogScalarF64", task=task, value=1.0, auto_start=False)
    assert refused == -200846
    for voltage_V, code in ((10.01, -200561), (float("nan"), -200561)):
        fields = {"task": task, "value": voltage_V, "auto_start": True}
        assert call.refused("WriteAnalogScalarF64", **fields) == code
    call("WriteAnalogScalarF64", task=task, value=1.2345, auto_start=True)
    assert call.rig.voltages_V == [round(1.2345 * 65536 / 20.0) * 20.0 / 65536]
    read = call("ReadAnalogScalarF64", task=call.task(DRIVE)).value
    assert read == call.rig.voltages_V[0]


def test_a_wave_needs_all_its_samples_and_is_played_once() -> None:
    call = Caller()
    task = call.clocked(OUTPUT, rate_hz=1000.0, mode=FINITE, count=4)
    call("SetBufferAttributeUInt32", task=task, attribute_raw=BUFFER["ao"], value=4)
    write = {"task": task, "data_layout_raw": 0}
    call("WriteAnalogF64", write_array=[0.0, 1.25], **write)
    assert call.refused("StartTask", task=task) == -200462
    call("WriteAnalogF64", write_array=[2.5, 0.0], **write)
    assert call.refused("WriteAnalogF64", write_array=[0.0], **write) == -200292
    call("StartTask", task=task)
    assert call.rig.wave == ([0.0, 1.25, 2.5, 0.0], 1000.0)
    assert not call("IsTaskDone", task=task).is_task_done
    call.rig.wave_over = True
    assert call("IsTaskDone", task=task).is_task_done
    assert call.rig.went_on == 2
    assert call.rig.voltages_V == []


def test_a_waveform_may_be_written_during_its_output_and_stops_at_a_buffer_underrun() -> None:
    call = Caller()
    task = call.clocked(OUTPUT, rate_hz=1000.0, mode=FINITE, count=6)
    call("SetBufferAttributeUInt32", task=task, attribute_raw=BUFFER["ao"], value=6)
    call("SetWriteAttributeInt32", task=task, attribute_raw=0x1453, value_raw=10158)
    assert call.refused("StartTask", task=task) == -200462
    write = {"task": task, "data_layout_raw": 0}
    call("WriteAnalogF64", write_array=[0.0, 1.25], **write)
    call("StartTask", task=task)
    call("WriteAnalogF64", write_array=[2.5, 5.0], **write)
    assert call.rig.wave == ([0.0, 1.25, 2.5, 5.0], 1000.0)
    assert not call("IsTaskDone", task=task).is_task_done
    call.rig.wave_over = True
    assert call.refused("IsTaskDone", task=task) == -200290
    assert call.refused("WriteAnalogF64", write_array=[0.0, 0.0], **write) == -200290


def test_a_buffer_sized_by_its_first_write_refuses_a_second_write() -> None:
    call = Caller()
    task = call.clocked(OUTPUT, rate_hz=1000.0, mode=FINITE, count=4)
    call("WriteAnalogF64", task=task, data_layout_raw=0, write_array=[0.0, 1.25])
    assert call.refused("WriteAnalogF64", task=task, write_array=[0.0]) == -200547


def capture(call: Caller, count: int = 50) -> Session:
    task = call.clocked(POSITION, DRIVE, rate_hz=1000.0, mode=CONTINUOUS, count=count)
    call("SetBufferAttributeUInt32", task=task, attribute_raw=BUFFER["ai"], value=count)
    call("StartTask", task=task)
    return task


def read(call: Caller, task: Session, count: int, order: FillMode) -> Any:
    fields = {"num_samps_per_chan": count, "fill_mode_raw": order.value, "timeout": 0.01}
    return call("ReadAnalogF64", task=task, array_size_in_samps=100, **fields)


def test_a_capture_delivers_one_sample_immediately_and_then_one_per_period() -> None:
    call = Caller(5.0)
    task = capture(call)
    reply = read(call, task, 1, FillMode.GROUP_BY_CHANNEL)
    assert list(reply.read_array) == [round(0.5 * 65536 / 20.0) * 20.0 / 65536, 0.0]
    call.rig.now_s = 0.003
    values = {"task": task, "attribute_raw": AVAILABLE}
    assert call("GetReadAttributeUInt32", **values).value == 3
    by_channel = read(call, task, 2, FillMode.GROUP_BY_CHANNEL)
    assert by_channel.samps_per_chan_read == 2
    assert by_channel.read_array[2:] == pytest.approx([0.25, 0.25], abs=2e-4)
    by_scan = read(call, task, 1, FillMode.GROUP_BY_SCAN_NUMBER)
    assert list(by_scan.read_array) == pytest.approx([0.503, 0.25], abs=2e-4)


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_reply_with_missing_samples_has_an_error_status(lockstep: bool) -> None:
    call = Caller(lockstep=lockstep)
    reply = read(call, capture(call), 2, FillMode.GROUP_BY_CHANNEL)
    assert reply.status == -200284
    assert not reply.read_array


def test_replies_have_an_error_status_from_a_buffer_overflow_until_the_task_is_cleared() -> None:
    call = Caller()
    task = capture(call)
    call.rig.now_s = 0.06
    for _ in range(2):
        assert read(call, task, 1, FillMode.GROUP_BY_CHANNEL).status == -200279
    call("ClearTask", task=task)
    assert call.rig.capture_hz == 0.0
    again = capture(call)
    assert read(call, again, 1, FillMode.GROUP_BY_CHANNEL).status == 0
    call.rig.overflown = True
    assert read(call, again, 1, FillMode.GROUP_BY_CHANNEL).status == -200279


def test_a_session_is_found_by_its_name() -> None:
    call = Caller()
    assert call.said("CreateTask", session_name="a", initialization_behavior=2).startswith(
        b"status\0FAILED_PRECONDITION\0"
    )
    made = call("CreateTask", session_name="a", initialization_behavior=1)
    assert made.new_session_initialized
    found = call("CreateTask", session_name="a", initialization_behavior=2)
    assert (found.task.id, found.new_session_initialized) == (made.task.id, False)
    assert call.said("CreateTask", session_name="a", initialization_behavior=1).startswith(
        b"status\0ALREADY_EXISTS\0"
    )
    name = call("GetTaskAttributeString", task=found.task, attribute_raw=0x1276).value
    assert name == "a"


def test_each_call_is_assigned_to_the_inputs_or_to_the_outputs_of_the_device() -> None:
    call = Caller()
    sides = {call.task(POSITION).id: "sensor", call.task(OUTPUT).id: "output", 99: ""}
    for number, side in sides.items():
        request = messages.StartTaskRequest(task=Session(id=number)).SerializeToString()
        assert call.daq.side(SERVICE + b"StartTask\0" + request) == side
    assert call.daq.side(SERVICE + b"CreateAOVoltageChan\0") == "output"
    assert call.daq.side(SERVICE + b"GetErrorString\0") == ""
    assert call.daq.side(b"\xff") == ""


def test_invalid_calls_are_refused_or_ignored() -> None:
    call = Caller()
    assert call.said("GetTaskAttributeUInt32").startswith(b"status\0UNIMPLEMENTED\0")
    for line in (b"", b"StartTask\0", SERVICE + b"StartTask"):
        assert call.daq.answer(line) is None
    torn = call.daq.answer(SERVICE + b"StartTask\0\xff")
    assert torn is not None
    assert torn.startswith(b"status\0INTERNAL\0StartTask: no such message")


def strange(chance: random.Random) -> bytes:
    """Return a message with random fields that names a task that may not exist."""
    body = b"\n\x02\x10%c" % chance.randrange(6)
    for _ in range(chance.randrange(4)):
        tag = chance.randrange(2, 8) << 3
        double = bytes((tag | 1,)) + chance.randbytes(8)
        body += chance.choice((double, bytes((tag, chance.randrange(128)))))
    return body + chance.randbytes(chance.choice((0, 0, 0, 3)))


def test_the_server_survives_arbitrary_calls() -> None:
    chance = random.Random(SEED)
    call = Caller()
    for task in (call.task(POSITION), call.task(OUTPUT), capture(call)):
        assert task.id
    names = [name.encode() for name in call.daq.calls if name != "ClearTask"]
    kinds: dict[bytes, int] = {b"ok": 0, b"ni-error": 0, b"status": 0}
    for _ in range(CALLS):
        reply = call.daq.answer(SERVICE + chance.choice(names) + b"\0" + strange(chance))
        assert reply is not None, f"seed {SEED}"
        kinds[reply.partition(b"\0")[0]] += 1
        assert all(abs(voltage_V) <= 10.0 for voltage_V in call.rig.voltages_V)
        call.rig.voltages_V.clear()
    assert min(kinds.values()) > CALLS / 10, kinds
