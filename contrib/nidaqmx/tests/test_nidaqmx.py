"""The NI-DAQmx drivers fulfil the contract of all drivers over memory, gRPC and a recording."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import count
from pathlib import Path

import pytest

from contrib.support.wired_rig import DRIVE, OUTPUT, POSITION, HandRig
from pincette.config import ConfigError, Output, Sensor
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.line.recording import Recorder, RecordingLink
from pincette.instruments.line.replay import ReplayLink
from pincette.instruments.protocols import (
    BufferedSensor,
    InstrumentError,
    Link,
    PartsOutput,
    WaveOutput,
)
from pincette.sim.instruments.protocol import TERMINATOR, Instrument
from pincette_nidaqmx import position_sensor, voltage_output
from pincette_nidaqmx.simulated.daq import SimulatedDaq
from pincette_nidaqmx.simulated.daq_task import Terminals
from pincette_nidaqmx.simulated.server import DaqServer
from tests.contract.conftest import offer_replayed
from tests.contract.test_position_sensor import PositionSensorContract
from tests.contract.test_voltage_output import VoltageOutputContract

STEP_V = 20.0 / 65536
UM_PER_V = 1.0 / STEP_V  # so that whole micrometres are whole steps of the converter

Reach = Callable[..., tuple[str, Link | None]]


def in_memory(instrument: Instrument, _terminator: bytes = TERMINATOR) -> tuple[str, Link | None]:
    return "memory://", MemoryLink(instrument.answer, None)


def on_a_server(fronts: ExitStack) -> Reach:
    def offer(instrument: Instrument, _end: bytes = TERMINATOR) -> tuple[str, Link | None]:
        return fronts.enter_context(DaqServer("grpc://127.0.0.1:0", instrument)).url, None

    return offer


def recorded(folder: Path) -> Reach:
    numbers = count()

    def offer(instrument: Instrument, _end: bytes = TERMINATOR) -> tuple[str, Link | None]:
        recorder = Recorder(folder / f"{next(numbers)}.txt", "memory://", b"", lambda: 0.0)
        return "memory://", RecordingLink(MemoryLink(instrument.answer, None), recorder)

    return offer


@pytest.fixture(params=["memory", "grpc", "recording"])
def reach(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Reach]:
    if request.param == "memory":
        yield in_memory
    elif request.param == "grpc":
        with ExitStack() as fronts:
            yield on_a_server(fronts)
    else:
        getattr(request.instance, request.function.__name__)(recorded(tmp_path))
        played = list[ReplayLink]()
        yield offer_replayed(tmp_path, played)
        assert played
        assert all(replay.ended for replay in played)


def sensor_settings(url: str, **options: str | float) -> Sensor:
    wanted = {"um_per_V": UM_PER_V, "channel": POSITION, "drive_channel": DRIVE, **options}
    return Sensor(
        driver="nidaqmx",
        url=url,
        minimum_um=-9999.0,
        maximum_um=9999.0,
        noise_um=0.03,
        timeout_s=0.5,
        options=dict(wanted),
    )


def output_settings(url: str, **options: str | float) -> Output:
    wanted = {"channel": OUTPUT, **options}
    return Output(driver="nidaqmx", url=url, timeout_s=0.5, options=dict(wanted))


def device(rig: HandRig) -> SimulatedDaq:
    wired = Terminals(UM_PER_V, 0.0, POSITION, (DRIVE,), OUTPUT)
    return SimulatedDaq(rig, wired, lockstep=True)


class TestInput(PositionSensorContract):
    step_um, far_um, tells_causes = 1.0, 40_000.0, True

    def instrument(self, measure: Callable[[], float | None]) -> Instrument:
        return device(HandRig(measure))

    def open(self, url: str, link: Link | None) -> BufferedSensor:
        return position_sensor.open_sensor(sensor_settings(url), link)


class TestInputThatAverages(TestInput):
    def open(self, url: str, link: Link | None) -> BufferedSensor:
        return position_sensor.open_sensor(sensor_settings(url, average=4), link)


class TestInputTurnedRound(TestInput):
    """The monitor voltage falls when the position rises."""

    def instrument(self, measure: Callable[[], float | None]) -> Instrument:
        wired = Terminals(-UM_PER_V, 0.0, POSITION)
        return SimulatedDaq(HandRig(measure), wired, lockstep=True)

    def open(self, url: str, link: Link | None) -> BufferedSensor:
        return position_sensor.open_sensor(sensor_settings(url, um_per_V=-UM_PER_V), link)


class TestOutput(VoltageOutputContract):
    step_V, limit_V = STEP_V, 10.0

    def instrument(self, put_out: Callable[[float], None]) -> Instrument:
        rig = HandRig()
        rig.put_out = put_out
        return device(rig)

    def open(self, url: str, link: Link | None) -> WaveOutput:
        return voltage_output.open_output(output_settings(url), link)

    def test_a_silent_sensor_is_an_error_until_it_answers(self, reach: Reach) -> None:
        """The contract of every driver; 2 V is not a multiple of the step of this output."""
        with self.opened(reach) as (load, output):
            load.voice = lambda _line: None
            with pytest.raises(InstrumentError, match="no answer") as caught:
                output.write_V(1.0)
            assert caught.value.code == "silent"
            load.voice = None
            output.write_V(2.0)
            assert load.voltages_V == [pytest.approx(2.0, abs=0.501 * STEP_V)]


class TestCapture:
    """Buffered acquisition, over every kind of link."""

    def opened(self, reach: Reach, **options: float) -> tuple[HandRig, BufferedSensor]:
        rig = HandRig(lambda: 20.0)
        url, link = reach(device(rig))
        return rig, position_sensor.open_sensor(sensor_settings(url, **options), link)

    def test_each_block_has_the_samples_since_the_previous_block(self, reach: Reach) -> None:
        rig, sensor = self.opened(reach)
        sensor.begin_capture(20_000.0)
        assert len(sensor.read_block().x_um) == 1
        for periods in (1, 3):
            rig.now_s += 0.02 * periods
            block = sensor.read_block()
            assert len(block.x_um) == len(block.drive_V) == 400 * periods
            assert block.x_um[0] == pytest.approx(20.01, abs=0.501)
            assert block.drive_V[-1] == pytest.approx(0.25, abs=STEP_V)
        with pytest.raises(InstrumentError, match="a capture is running"):
            sensor.read_um()
        sensor.end_capture()
        assert sensor.read_um() == 20.0
        sensor.end_capture()
        sensor.close()

    def test_a_block_of_twenty_seconds_needs_several_calls(self, reach: Reach) -> None:
        rig, sensor = self.opened(reach)
        sensor.begin_capture(20_000.0)
        rig.now_s = 19.9
        x_um, drive_V = sensor.read_block()
        assert len(x_um) == len(drive_V) == 398_001
        sensor.close()

    def test_an_overflowing_buffer_is_an_error_and_the_capture_can_be_restarted(
        self, reach: Reach
    ) -> None:
        rig, sensor = self.opened(reach)
        sensor.begin_capture(1000.0)
        rig.now_s = 21.0
        with pytest.raises(InstrumentError, match="-200279") as caught:
            sensor.read_block()
        assert caught.value.code == "invalid"
        sensor.begin_capture(1000.0)
        assert len(sensor.read_block().x_um) == 1
        sensor.close()

    def test_missing_samples_are_an_error(self, reach: Reach) -> None:
        _, sensor = self.opened(reach)
        sensor.begin_capture(1000.0)
        sensor.read_block()
        with pytest.raises(InstrumentError, match="-200284") as caught:
            sensor.read_block()
        assert caught.value.code == "silent"
        sensor.close()

    def test_unsupported_captures_are_refused(self, reach: Reach) -> None:
        _, sensor = self.opened(reach, rate_hz=1000.0)
        with pytest.raises(InstrumentError, match="no capture was started"):
            sensor.read_block()
        for rate_hz in (1001.0, 0.0, float("nan")):
            with pytest.raises(InstrumentError, match="Hz refused, limit 1000 Hz"):
                sensor.begin_capture(rate_hz)
        assert sensor.read_um() == 20.0
        sensor.close()


class TestWave:
    """Buffered output, over every kind of link."""

    def opened(self, reach: Reach) -> tuple[HandRig, WaveOutput]:
        rig = HandRig()
        url, link = reach(device(rig))
        return rig, voltage_output.open_output(output_settings(url), link)

    def test_a_wave_plays_to_its_end(self, reach: Reach) -> None:
        rig, output = self.opened(reach)
        output.begin_wave([0.0, 1.25, 2.5], 10_000.0)
        output.look()
        with pytest.raises(InstrumentError, match="a wave plays"):
            output.read_V()
        rig.wave_over = True
        output.look()
        assert output.read_V() == 2.5
        assert rig.wave == ([0.0, 1.25, 2.5], 10_000.0)
        assert rig.went_on == 2
        output.close()

    def test_a_single_write_or_a_new_wave_ends_a_running_wave(self, reach: Reach) -> None:
        rig, output = self.opened(reach)
        for last_V in (1.25, 2.5):
            output.begin_wave([0.0, last_V], 10_000.0)
            assert rig.wave == ([0.0, last_V], 10_000.0)
        output.write_V(-1.25)
        assert rig.voltages_V == [-1.25]
        assert output.read_V() == -1.25
        with pytest.raises(InstrumentError, match="no wave plays"):
            output.look()
        output.begin_wave([5.0], 10_000.0)
        assert rig.wave == ([5.0, 5.0], 10_000.0)
        output.close()

    def test_a_long_waveform_is_written_during_its_output(self, reach: Reach) -> None:
        rig, output = self.opened(reach)
        output.begin_wave([1.25] * 39_999 + [0.0], 20_000.0)
        assert rig.wave is not None
        assert len(rig.wave[0]) == 10_000
        for _ in range(10):
            output.look()
        assert rig.wave[0] == [1.25] * 39_999 + [0.0]
        rig.wave_over = True
        output.look()
        assert output.read_V() == 0.0
        output.close()

    def test_a_buffer_underrun_of_a_waveform_is_an_error(self, reach: Reach) -> None:
        rig, output = self.opened(reach)
        output.begin_wave([1.25] * 39_999 + [0.0], 20_000.0)
        rig.wave_over = True
        for _ in range(2):
            with pytest.raises(InstrumentError, match="-200290"):
                output.look()
        output.write_V(0.0)
        assert rig.voltages_V == [0.0]
        output.close()

    def test_unsupported_waves_are_refused_before_anything_moves(self, reach: Reach) -> None:
        rig, output = self.opened(reach)
        for voltages_V, rate_hz in (([0.0, 10.1], 1e3), ([float("nan")], 1e3), ([], 1e3)):
            with pytest.raises(InstrumentError) as caught:
                output.begin_wave(voltages_V, rate_hz)
            assert caught.value.code == "misused"
        with pytest.raises(InstrumentError, match="60000 Hz refused, limit 50000 Hz"):
            output.begin_wave([0.0, 1.0], 60_000.0)
        assert rig.wave is None
        output.write_V(1.25)
        output.close()


class TestParts:
    """Steps in parts by the clock of the device, over every kind of link."""

    def opened(self, reach: Reach, **options: float) -> tuple[HandRig, PartsOutput]:
        rig = HandRig()
        url, link = reach(device(rig))
        output = voltage_output.open_output(output_settings(url, **options), link)
        assert isinstance(output, PartsOutput)
        return rig, output

    def test_each_step_is_played_and_its_last_voltage_is_read_back(self, reach: Reach) -> None:
        rig, output = self.opened(reach)
        for end_V in (2.5, 0.0, 5.0):
            parts_V = [0.25 * end_V, 0.75 * end_V, end_V]
            output.write_parts(parts_V, 0.001)
            assert rig.wave == (pytest.approx(parts_V, abs=STEP_V), 1000.0)
            assert output.read_V() == end_V
        assert not rig.voltages_V
        output.close()

    def test_a_write_or_a_waveform_cancels_the_remaining_parts_of_a_step(
        self, reach: Reach
    ) -> None:
        rig, output = self.opened(reach)
        output.write_parts([1.25, 2.5, 5.0], 0.001)
        output.write_V(1.25)
        assert rig.voltages_V == [1.25]
        assert output.read_V() == 1.25
        output.write_parts([1.25, 2.5, 5.0], 0.002)
        assert rig.wave == ([1.25, 2.5, 5.0], 500.0)
        assert isinstance(output, WaveOutput)
        output.begin_wave([0.0, 2.5], 10_000.0)
        assert rig.wave == ([0.0, 2.5], 10_000.0)
        output.write_parts([1.25, 2.5, 5.0], 0.002)
        assert rig.wave == ([1.25, 2.5, 5.0], 500.0)
        output.close()

    def test_unsupported_voltages_are_refused_before_anything_moves(self, reach: Reach) -> None:
        rig, output = self.opened(reach, rate_hz=1000.0)
        for voltages_V, interval_s in (
            ([0.0, 10.1, 0.0], 0.001),
            ([0.0, float("nan"), 0.0], 0.001),
            ([], 0.001),
            ([0.0, 1.0, 2.0], 0.0005),
            ([0.0, 1.0, 2.0], float("nan")),
        ):
            with pytest.raises(InstrumentError) as caught:
                output.write_parts(voltages_V, interval_s)
            assert caught.value.code == "misused"
        assert rig.wave is None
        output.write_V(1.25)
        output.close()


@pytest.mark.parametrize(
    ("url", "channel"), [("ni:cDAQ1Mod1", ""), ("grpc://here:1", ""), ("memory://", "ai0")]
)
def test_a_channel_must_be_named(url: str, channel: str) -> None:
    with pytest.raises(ConfigError, match="is not a physical channel"):
        position_sensor.open_sensor(
            sensor_settings(url, channel=channel), in_memory(device(HandRig()))[1]
        )


@pytest.mark.parametrize(
    ("option", "value"), [("um_per_V", 0.0), ("average", 0), ("rate_hz", 0.0), ("colour", "red")]
)
def test_impossible_options_are_refused(option: str, value: float | str) -> None:
    with pytest.raises(ConfigError, match=f"nidaqmx option {option} = {value!r}"):
        position_sensor.timing(sensor_settings("memory://", **{option: value}))


def test_the_minimum_period_is_stated() -> None:
    stated = position_sensor.timing(sensor_settings("memory://"))
    assert stated.exchange_s == 0.001
    assert stated.bandwidth_hz == 12_500.0
    assert (
        position_sensor.timing(sensor_settings("memory://", drive_channel="")).buffered_hz is None
    )
    assert voltage_output.timing(output_settings("memory://", rate_hz=2e4)).bandwidth_hz == 5_000.0
    parts = output_settings("memory://").model_copy(update={"shaping": True})
    assert voltage_output.timing(parts).exchange_s == 0.003
