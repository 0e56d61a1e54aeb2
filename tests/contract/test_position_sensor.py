"""Contract of every driver of a position sensor, over every kind of link."""

from collections.abc import Callable, Generator
from contextlib import contextmanager

import pytest

from pincette.config import ConfigError, Sensor
from pincette.instruments import keyence_lkg
from pincette.instruments.protocols import InstrumentError, Link, PositionSensor
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.protocol import Instrument

Reach = Callable[[Instrument], tuple[str, Link | None]]
TIMEOUT_S = 0.1
GARBAGE = (b"", b"\xff\x00;", b"nan", b"1.0", b"MS,01,", b"MS,01,+NAN0000", b"MS,01,+1.5")


def _always(reply: bytes) -> Callable[[bytes], bytes]:
    return lambda _line: reply


class Target:
    """The object in front of an instrument; its value can be replaced by the test."""

    def __init__(self, instrument: Callable[[Callable[[], float | None]], Instrument]) -> None:
        self.x_um: float | None = 0.0
        self.voice: Callable[[bytes], bytes | None] | None = None
        self._instrument = instrument(lambda: self.x_um)

    def answer(self, line: bytes) -> bytes | None:
        return self._instrument.answer(line) if self.voice is None else self.voice(line)

    def idle(self) -> None:
        self._instrument.idle()


class PositionSensorContract:
    """Base class of the tests; a subclass states how the driver is opened and which instrument it
    reads."""

    step_um: float
    far_um: float
    tells_causes = False
    """True if the driver distinguishes readings out of range from invalid readings."""

    def instrument(self, measure: Callable[[], float | None]) -> Instrument:
        raise NotImplementedError

    def open(self, url: str, link: Link | None) -> PositionSensor:
        raise NotImplementedError

    @contextmanager
    def opened(self, reach: Reach) -> Generator[tuple[Target, PositionSensor]]:
        target = Target(self.instrument)
        sensor = self.open(*reach(target))
        yield target, sensor
        sensor.close()

    def test_a_sensor_reads_the_present_position(self, reach: Reach) -> None:
        with self.opened(reach) as (target, sensor):
            for x_um in (0.0, 30.02, -12.575, 1234.5, -9000.0):
                target.x_um = x_um
                assert sensor.read_um() == pytest.approx(x_um, abs=0.501 * self.step_um)

    def test_an_invalid_measurement_is_an_error_until_the_next_valid_one(
        self, reach: Reach
    ) -> None:
        with self.opened(reach) as (target, sensor):
            for x_um, cause in (
                (self.far_um, "above the measuring range"),
                (-self.far_um, "below the measuring range"),
                (None, "invalid reading"),
            ):
                target.x_um = x_um
                with pytest.raises(InstrumentError, match=cause) as caught:
                    sensor.read_um()
                if self.tells_causes:
                    assert caught.value.code == ("invalid" if x_um is None else "out_of_range")
            target.x_um = 1.0
            assert sensor.read_um() == 1.0

    def test_a_silent_sensor_is_an_error_until_it_answers(self, reach: Reach) -> None:
        with self.opened(reach) as (target, sensor):
            target.voice = lambda _line: None
            with pytest.raises(InstrumentError, match="no answer") as caught:
                sensor.read_um()
            assert caught.value.code == "silent"
            target.voice, target.x_um = None, 2.0
            assert sensor.read_um() == 2.0

    def test_garbage_is_an_error(self, reach: Reach) -> None:
        with self.opened(reach) as (target, sensor):
            for garbage in GARBAGE:
                target.voice = _always(garbage)
                with pytest.raises(InstrumentError) as caught:
                    sensor.read_um()
                assert caught.value.code == "garbled"

    def test_a_closed_sensor_is_reported_and_may_be_closed_again(self, reach: Reach) -> None:
        with self.opened(reach) as (_, sensor):
            sensor.close()
            with pytest.raises(InstrumentError, match="port is closed") as caught:
                sensor.read_um()
            assert caught.value.code == "misused"

    def test_a_silent_instrument_is_not_opened(self, reach: Reach) -> None:
        target = Target(self.instrument)
        target.voice = lambda _line: None
        with pytest.raises(InstrumentError, match="no answer"):
            self.open(*reach(target))


def settings(url: str = "memory://", /, **options: str | float | bool) -> Sensor:
    return Sensor(
        driver="keyence_lkg",
        url=url,
        minimum_um=-9999.0,
        maximum_um=9999.0,
        timeout_s=TIMEOUT_S,
        noise_um=0.03,
        options=dict(options),
    )


class TestKeyenceMicrometres(PositionSensorContract):
    step_um, far_um, tells_causes = 0.01, 10_000.0, True

    def instrument(self, measure: Callable[[], float | None]) -> Instrument:
        return SimulatedKeyence(measure)

    def open(self, url: str, link: Link | None) -> PositionSensor:
        return keyence_lkg.open_sensor(settings(url), link)


@pytest.mark.parametrize("reach", ["memory"], indirect=True)
class TestKeyenceMillimetres(PositionSensorContract):
    step_um, far_um, tells_causes = 0.01, 10_000.0, True

    def instrument(self, measure: Callable[[], float | None]) -> Instrument:
        return SimulatedKeyence(measure, "mm")

    def open(self, url: str, link: Link | None) -> PositionSensor:
        return keyence_lkg.open_sensor(settings(url, unit="mm", output=12), link)


class Lines:
    """A link that replies from a table."""

    def __init__(self, table: dict[bytes, bytes]) -> None:
        self.table = table
        self.closed = False

    def exchange(self, request: bytes) -> bytes:
        return self.table[request]

    def tell(self, line: bytes) -> None:
        raise AssertionError(f"{line!r} has an answer")

    def close(self) -> None:
        self.closed = True


def test_the_driver_allows_enough_time_to_leave_set_up_mode(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    slept = list[float]()
    monkeypatch.setattr(keyence_lkg.time, "sleep", slept.append)
    instrument = SimulatedKeyence(lambda: 1.0)
    instrument.answer(b"Q0")
    reply = instrument.answer(b"MS,01")
    assert reply == b"ER,MS,51"
    link = Lines({b"R0": b"R0", b"MS,01": b"MS,01,+0001.00"})
    sensor = keyence_lkg.open_sensor(settings(), link)
    link.table[b"MS,01"] = reply
    assert slept == [keyence_lkg.MODE_CHANGE_S]
    with pytest.raises(InstrumentError, match=r"error 51 \(not in this mode\)") as caught:
        sensor.read_um()
    assert caught.value.code == "refused"


@pytest.mark.parametrize("reply", [b"ER,R0,99", b"ER,R0,50", b"hello", b"MS,01,+0001.00"])
def test_an_unexpected_answer_to_the_mode_closes_the_port(reply: bytes) -> None:
    link = Lines({b"R0": reply})
    with pytest.raises(InstrumentError, match="R0"):
        keyence_lkg.open_sensor(settings(), link)
    assert link.closed


def test_an_answer_to_another_output_is_refused() -> None:
    link = Lines({b"R0": b"ER,R0,01", b"MS,01": b"MS,02,+0001.00"})
    with pytest.raises(InstrumentError, match="not an answer to"):
        keyence_lkg.open_sensor(settings(), link)


def answering(value: bytes) -> Lines:
    return Lines({b"R0": b"ER,R0,01", b"MS,01": b"MS,01," + value})


@pytest.mark.parametrize(
    ("unit", "value", "position_um"),
    [
        ("um", b"+0012.34", 12.34),
        ("um", b"-001.234", -1.234),
        ("um", b"+00012.3", 12.3),
        ("mm", b"+0.01234", 12.34),
        ("mm", b"-00.0123", -12.3),
    ],
)
def test_displays_with_a_sensible_step_are_accepted(
    unit: str, value: bytes, position_um: float
) -> None:
    sensor = keyence_lkg.open_sensor(settings(unit=unit), answering(value))
    assert sensor.read_um() == pytest.approx(position_um)


@pytest.mark.parametrize(
    ("unit", "value", "step_um"),
    [
        ("um", b"+0000123", "1 µm"),
        ("mm", b"+0000123", "1000 µm"),
        ("um", b"+000123.", "1 µm"),
        ("mm", b"+0012.34", "10 µm"),
        ("mm", b"+001.234", "1 µm"),
        ("um", b"+0.01234", "1e-05 µm"),
        ("um", b"+00.0123", "0.0001 µm"),
    ],
)
def test_displays_with_another_unit_or_step_are_refused(
    unit: str, value: bytes, step_um: str
) -> None:
    link = answering(value)
    with pytest.raises(InstrumentError, match=step_um) as caught:
        keyence_lkg.open_sensor(settings(unit=unit), link)
    assert caught.value.code == "refused"
    assert link.closed


def test_the_display_is_checked_at_the_first_value() -> None:
    link = answering(b"+FFFFFFF")
    sensor = keyence_lkg.open_sensor(settings(), link)
    link.table[b"MS,01"] = b"MS,01,+0000123"
    with pytest.raises(InstrumentError, match="1 µm") as caught:
        sensor.read_um()
    assert caught.value.code == "refused"


def test_a_display_whose_settings_change_during_reading_is_refused() -> None:
    link = answering(b"+0012.34")
    sensor = keyence_lkg.open_sensor(settings(), link)
    link.table[b"MS,01"] = b"MS,01,+012.345"
    with pytest.raises(InstrumentError, match="3 decimals") as caught:
        sensor.read_um()
    assert caught.value.code == "refused"
    link.table[b"MS,01"] = b"MS,01,+0012.35"
    assert sensor.read_um() == pytest.approx(12.35)


def test_opening_a_port_warns_that_the_driver_was_not_tested_with_its_instrument(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(*_wanted: object, **_how: object) -> Lines:
        return answering(b"+0001.00")

    keyence_lkg.open_sensor(settings(), opened())
    assert not caplog.records
    monkeypatch.setattr(keyence_lkg, "open_link", opened)
    keyence_lkg.open_sensor(settings())
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "has not been tested with its instrument" in caplog.text


@pytest.mark.parametrize(
    ("option", "value"),
    [("output", 13), ("output", "1"), ("unit", "nm"), ("baud", 12345), ("colour", "red")],
)
def test_impossible_options_are_refused(option: str, value: str | int) -> None:
    with pytest.raises(ConfigError, match=f"keyence_lkg option {option} = {value!r}"):
        keyence_lkg.open_sensor(settings(**{option: value}))


@pytest.mark.parametrize(("baud", "exchange_ms"), [(9600, 21.9), (38400, 5.5), (115200, 1.8)])
def test_the_duration_of_a_reading_is_computed_from_the_line_settings(
    baud: int, exchange_ms: float
) -> None:
    timing = keyence_lkg.timing(settings(baud=baud))
    assert round(1e3 * timing.exchange_s, 1) == exchange_ms
    assert timing.buffered_hz is None
    assert "assumed" in timing.note


def test_a_reopened_port_finds_the_instrument_measuring_or_reports_the_mode_change() -> None:
    prepare = _on_open_of(settings("/dev/sensor"))
    prepare(Lines({b"R0": b"ER,R0,01"}))
    with pytest.raises(InstrumentError, match="changing to measuring mode") as caught:
        prepare(Lines({b"R0": b"R0"}))
    assert caught.value.code == "refused"


def _on_open_of(sensor: Sensor) -> Callable[[Link], None]:
    """Return the function that the driver passes to a link for a port that has been reopened."""
    given = list[Callable[[Link], None]]()

    def opened(*_wanted: object, on_open: Callable[[Link], None], **_how: object) -> Lines:
        given.append(on_open)
        return answering(b"+0001.00")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(keyence_lkg, "open_link", opened)
        keyence_lkg.open_sensor(sensor)
    return given[0]
