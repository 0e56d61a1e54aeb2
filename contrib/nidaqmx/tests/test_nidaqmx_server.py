"""The NI-DAQmx drivers if a package or server is missing, disconnects, or sends invalid replies."""

import logging
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from contrib.support.wired_rig import DRIVE, OUTPUT, POSITION, WIRED, HandRig
from pincette.config import Output, Sensor
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.protocols import BufferedSensor, InstrumentError, Link, WaveOutput
from pincette.sim.wires.ports import WireError
from pincette_nidaqmx import position_sensor, voltage_output
from pincette_nidaqmx.rpc_link import LinkChannel
from pincette_nidaqmx.simulated.daq import SimulatedDaq
from pincette_nidaqmx.simulated.daq_task import Terminals
from pincette_nidaqmx.simulated.server import DaqServer
from tests.support.rigs import free_ports

SEED = 1272
REPLIES = 20_000
GONE = 0.01

LOOP_BACK = "cDAQ1Mod3/ai0"
MEMORY = "grpc://memory:1"


def sensor_at(url: str, link: Link | None = None, record: str | None = None) -> BufferedSensor:
    settings = Sensor(
        driver="nidaqmx",
        url=f"{url}/{POSITION}",
        minimum_um=-99.0,
        maximum_um=99.0,
        noise_um=0.03,
        timeout_s=0.5,
        record=record,
        options={"um_per_V": 10.0, "drive_channel": DRIVE},
    )
    return position_sensor.open_sensor(settings, link)


def output_at(url: str, link: Link | None = None, **options: str | float) -> WaveOutput:
    settings = Output(driver="nidaqmx", url=f"{url}/{OUTPUT}", timeout_s=0.5, options=dict(options))
    return voltage_output.open_output(settings, link)


def device(rig: HandRig, terminals: Terminals = WIRED) -> SimulatedDaq:
    return SimulatedDaq(rig, terminals, lockstep=True)


def test_a_restarted_server_is_used_again() -> None:
    url = f"grpc://127.0.0.1:{free_ports(1)}"
    with DaqServer(url, device(HandRig(lambda: 5.0))):
        sensor, output = sensor_at(url), output_at(url)
        output.write_V(1.25)
    for act in (sensor.read_um, lambda: output.write_V(2.5)):
        with pytest.raises(InstrumentError, match="no answer") as caught:
            act()
        assert caught.value.code == "hung_up"
    rig = HandRig(lambda: 7.5)
    with DaqServer(url, device(rig)):
        eventually(sensor.read_um)
        assert sensor.read_um() == pytest.approx(7.5, abs=0.002)
        eventually(lambda: output.write_V(2.5))
        assert rig.voltages_V == [2.5]
        sensor.close()
        output.close()


def eventually(act: Callable[[], object]) -> None:
    """Wait until the channel is connected and the task exists again; some attempts fail before."""
    deadline_s = time.monotonic() + 10.0
    causes = set[str]()
    while time.monotonic() < deadline_s:
        try:
            act()
        except InstrumentError as error:
            causes.add(error.code)
            # gRPC reconnects in real time, and does not report when it has.
            time.sleep(0.02)
        else:
            assert causes <= {"hung_up"}
            return
    raise AssertionError("it never came back")


def test_tasks_left_by_an_earlier_program_are_cleared(caplog: pytest.LogCaptureFixture) -> None:
    rig = HandRig(lambda: 5.0)
    daq = device(rig)
    killed = output_at(MEMORY, MemoryLink(daq.answer, None))
    killed.begin_wave([0.0, 1.25], 1000.0)
    output = output_at(MEMORY, MemoryLink(daq.answer, None))
    assert "was left at the device server" in caplog.text
    output.write_V(2.5)
    assert rig.voltages_V == [2.5]
    with pytest.raises(InstrumentError, match="-200088") as caught:
        killed.look()
    assert caught.value.code == "hung_up"
    for why in ("-200088", "ALREADY_EXISTS"):
        with pytest.raises(InstrumentError, match=why):
            killed.write_V(0.0)
    assert rig.voltages_V == [2.5]


def test_a_task_whose_end_was_not_confirmed_is_cleared() -> None:
    rig = HandRig()
    daq = device(rig)
    deaf_to = [b""]

    def answer(request: bytes) -> bytes | None:
        reply = daq.answer(request)
        return None if deaf_to[0] and deaf_to[0] in request else reply

    output = output_at(MEMORY, MemoryLink(answer, None))
    deaf_to[0] = b"StartTask"
    with pytest.raises(InstrumentError, match="no answer"):
        output.begin_wave([0.0, 1.25], 1000.0)
    deaf_to[0] = b"CreateTask"
    with pytest.raises(InstrumentError, match="no answer"):
        output.write_V(1.25)
    deaf_to[0] = b""
    output.write_V(1.25)
    output.begin_wave([0.0, 2.5], 1000.0)
    assert rig.wave == ([0.0, 2.5], 1000.0)
    assert rig.voltages_V == [1.25]


def test_the_voltage_at_opening_is_measured_or_taken_from_the_options(
    caplog: pytest.LogCaptureFixture,
) -> None:
    daq = device(HandRig(), Terminals(output=OUTPUT, drives=(LOOP_BACK,)))
    first = output_at(MEMORY, MemoryLink(daq.answer, None), found_V=0.5)
    assert first.read_V() == 0.5
    assert "0.5 V is assumed" in caplog.text
    caplog.clear()
    first.write_V(1.25)
    first.close()
    again = output_at(MEMORY, MemoryLink(daq.answer, None), read_channel=LOOP_BACK)
    assert again.read_V() == 1.25
    assert not caplog.records


def test_a_missing_server_is_reported_with_what_to_start() -> None:
    with pytest.raises(InstrumentError, match="is the device server, or `pincette run rig`"):
        sensor_at(f"grpc://127.0.0.1:{free_ports(1)}")


def test_a_missing_local_driver_is_reported_with_what_to_install() -> None:
    with pytest.raises(InstrumentError, match="NI-DAQmx is not installed") as caught:
        voltage_output.open_output(Output(driver="nidaqmx", url=f"ni:{OUTPUT}"))
    assert caught.value.code == "cannot_open"
    local = Output(driver="nidaqmx", url=f"ni:{OUTPUT}", record="dialogue.txt")
    with pytest.raises(InstrumentError, match="cannot be recorded"):
        voltage_output.open_output(local)


def test_a_missing_package_is_reported_with_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "pincette_nidaqmx.tasks", None)
    for open_it in (sensor_at, output_at):
        with pytest.raises(InstrumentError, match=r"pip install 'pincette\[nidaqmx\]'") as caught:
            open_it("grpc://127.0.0.1:9")
        assert caught.value.code == "cannot_open"


def test_a_port_in_use_is_reported() -> None:
    with (
        DaqServer("grpc://127.0.0.1:0", device(HandRig())) as first,
        pytest.raises(WireError, match="is in use"),
    ):
        DaqServer(first.url, device(HandRig()))
    for url in ("socket://127.0.0.1:1", "grpc://127.0.0.1", "ni:Dev1/ai0"):
        with pytest.raises(WireError, match="needs grpc://host:port"):
            DaqServer(url, device(HandRig()))


def test_calls_are_recorded_logged_and_played_back(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "pincette_nidaqmx.rpc_link")
    path = tmp_path / "dialogue.txt"
    with DaqServer("grpc://127.0.0.1:0", device(HandRig(lambda: 5.0))) as front:
        sensor = sensor_at(front.url, record=str(path))
        seen_um = [sensor.read_um() for _ in range(3)]
        sensor.close()
    assert "ReadAnalogScalarF64" in caplog.text
    settings = Sensor(
        driver="nidaqmx",
        url=f"replay:{path}",
        minimum_um=-99.0,
        maximum_um=99.0,
        noise_um=0.03,
        timeout_s=0.5,
        options={"um_per_V": 10.0, "channel": POSITION},
    )
    replayed = position_sensor.open_sensor(settings)
    assert [replayed.read_um() for _ in range(3)] == seen_um
    replayed.close()


def test_a_channel_over_a_link_refuses_streams() -> None:
    channel = LinkChannel(MemoryLink(lambda _request: None, None))
    with pytest.raises(InstrumentError, match="does not support streams"):
        channel.unary_stream("/service/Events")(b"")


def test_drivers_raise_the_same_exception_type_for_every_invalid_answer() -> None:
    chance = random.Random(SEED)
    daq = device(HandRig(lambda: 5.0))
    heads = (b"ok\0", b"ok\0", b"ok\0", b"ni-error\0-200077\0", b"status\0", b"")
    strange = [False]

    def answer(request: bytes) -> bytes | None:
        if not strange[0] or b"ClearTask" in request:
            return daq.answer(request)
        if chance.random() < GONE:
            return b"ni-error\0-200088\0gone"
        tags = bytes((chance.choice((8, 9, 16, 17, 18, 24)),))
        return (
            chance.choice(heads)
            + tags * chance.randrange(2)
            + chance.randbytes(chance.randrange(12))
        )

    sensor = sensor_at(MEMORY, MemoryLink(answer, None))
    output = output_at(MEMORY, MemoryLink(answer, None))
    often: list[Callable[[], object]] = [
        sensor.read_um,
        sensor.read_block,
        lambda: output.write_V(1.0),
        output.look,
        output.read_V,
    ]
    seldom: list[Callable[[], object]] = [
        lambda: sensor.begin_capture(1000.0),
        sensor.end_capture,
        lambda: output.begin_wave([0.0, 1.0], 1000.0),
    ]
    sensor.begin_capture(1000.0)
    failed = 0
    for _ in range(REPLIES):
        strange[0] = chance.random() < 0.9
        try:
            chance.choice(often * 20 + seldom)()
        except InstrumentError:
            failed += 1
    assert REPLIES / 3 < failed < REPLIES, f"seed {SEED}"
