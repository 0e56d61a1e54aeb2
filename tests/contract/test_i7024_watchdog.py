"""The I-7024's own host watchdog: when it runs, when it trips, and which action clears it."""

from functools import partial

import pytest

from pincette.config import Output
from pincette.instruments import icpdas_i7024
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.line.serial_link import RETRY_S
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError, WatchedOutput
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.wires.wire import serve


def settings(url: str = "memory://", /, **options: str | float | bool) -> Output:
    return Output(driver="icpdas_i7024", url=url, timeout_s=0.5, options=dict(options))


class Bench:
    """A module on a clock that the test sets; its lines are recorded, and it can be unplugged."""

    def __init__(self, checksum: bool = False) -> None:
        self.now_s = 0.0
        self.line_s = 0.0
        self.plugged = True
        self.voltages_V: list[float] = []
        self.lines: list[bytes] = []
        self.module = SimulatedI7024(self.voltages_V.append, lambda: self.now_s, checksum=checksum)
        self.link = MemoryLink(self._answer)

    def _answer(self, line: bytes) -> bytes | None:
        self.lines.append(line)
        self.now_s += self.line_s
        return self.module.answer(line) if self.plugged else None

    def open(self, **options: str | float | bool) -> icpdas_i7024.I7024:
        return icpdas_i7024.open_output(settings(**options), self.link)

    def wait(self, duration_s: float) -> None:
        self.now_s += duration_s
        self.module.idle()


@pytest.mark.parametrize("ticks", [1, 3, 5, 7, 255])
def test_the_watchdog_is_armed_at_the_first_message(ticks: int) -> None:
    bench = Bench()
    output = bench.open(watchdog_s=round(0.1 * ticks, 1), channel=0)
    assert bench.lines == [b"$01M", b"$012", b"~**", b"~010", b"$0180", b"~0150"]
    bench.lines.clear()
    output.write_V(1.0)
    output.write_V(2.0)
    armed = [b"~010", b"~0131%02X" % ticks, b"~010"]
    assert bench.lines == [*armed, b"~**", b"#010+01.000", b"~**", b"#010+02.000"]
    bench.lines.clear()
    output.close()
    assert bench.lines == [b"~0130%02X" % ticks]
    output.close()
    assert len(bench.lines) == 1


def test_without_a_watchdog_no_watchdog_command_is_sent() -> None:
    bench = Bench()
    output = bench.open(watchdog_s=0)
    output.keep_alive()
    output.write_V(1.0)
    output.keep_alive()
    output.clear_trip()
    output.close()
    assert bench.lines == [b"$01M", b"$012", b"#010+01.000"]


def test_the_module_keeps_its_voltage_with_heartbeats_and_resets_it_without_them() -> None:
    bench = Bench()
    output = bench.open()
    assert isinstance(output, WatchedOutput)
    bench.wait(60.0)
    output.keep_alive()
    output.write_V(1.0)
    for _ in range(20):
        bench.wait(0.4)
        output.keep_alive()
    assert bench.voltages_V == [1.0]
    bench.wait(0.51)
    assert bench.voltages_V == [1.0, 0.0]


def test_a_trip_stays_until_it_is_cleared_and_the_watchdog_is_then_armed_again() -> None:
    bench = Bench()
    output = bench.open()
    output.write_V(1.0)
    bench.wait(0.51)
    for _ in range(3):
        with pytest.raises(InstrumentError, match=r"\+1\.100 V ignored.*tripped") as caught:
            output.write_V(1.1)
        assert caught.value.code == "tripped"
        output.keep_alive()
    assert output.read_V() == 0.0
    output.clear_trip()
    assert bench.voltages_V == [1.0, 0.0]
    output.write_V(0.5)
    bench.wait(0.51)
    assert bench.voltages_V == [1.0, 0.0, 0.5, 0.0]


def test_after_another_program_clears_a_trip_the_watchdog_is_soon_armed_again() -> None:
    bench = Bench()
    output = bench.open()
    output.write_V(1.0)
    bench.wait(0.51)
    with pytest.raises(InstrumentError, match="tripped"):
        output.write_V(1.0)
    bench.module.answer(b"~011")
    output.write_V(0.75)
    output.keep_alive()
    bench.wait(0.51)
    assert bench.voltages_V == [1.0, 0.0, 0.75, 0.0]


def test_an_earlier_trip_is_cleared_at_opening_with_a_warning(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench = Bench()
    bench.open().write_V(1.0)
    bench.wait(0.51)
    output = bench.open()
    assert "host watchdog had tripped" in caplog.text
    output.write_V(0.25)
    assert bench.voltages_V == [1.0, 0.0, 0.25]


def test_a_watchdog_of_an_earlier_host_does_not_trip_between_opening_and_first_feed() -> None:
    bench = Bench()
    bench.open().write_V(1.0)
    bench.wait(0.49)
    output = bench.open()
    bench.wait(0.49)
    assert output.read_V() == 1.0
    output.write_V(1.25)
    assert bench.voltages_V == [1.0, 1.25]


def test_a_trip_since_opening_is_reported_once_at_the_first_feed() -> None:
    bench = Bench()
    bench.open().write_V(1.0)
    output = bench.open()
    bench.wait(0.51)
    with pytest.raises(InstrumentError, match=r"heartbeat ignored.*tripped") as caught:
        output.keep_alive()
    assert caught.value.code == "tripped"
    output.keep_alive()
    assert bench.voltages_V == [1.0, 0.0]


def test_a_trip_between_reading_and_arming_is_reported_too() -> None:
    bench = Bench()
    bench.open().write_V(1.0)
    output = bench.open()
    bench.wait(0.49)
    bench.line_s = 0.01
    with pytest.raises(InstrumentError, match=r"heartbeat ignored.*tripped"):
        output.keep_alive()
    assert b"~013105" in bench.lines


@pytest.mark.parametrize("line_s", [0.0, 0.01])
def test_a_watchdog_switched_on_while_tripped_does_not_trip_again_when_cleared(
    line_s: float,
) -> None:
    bench = Bench()
    output = bench.open()
    output.write_V(1.0)
    bench.wait(0.51)
    assert bench.module.answer(b"~013105") == b"!01"
    bench.wait(9.0)
    bench.line_s = line_s
    output.clear_trip()
    assert output.read_V() == 0.0
    output.keep_alive()
    output.write_V(0.5)
    assert bench.voltages_V == [1.0, 0.0, 0.5]


def test_an_output_that_is_not_at_zero_keeps_its_safe_value(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench = Bench()
    bench.module.answer(b"#010+02.000")
    output = bench.open()
    assert b"~0150" not in bench.lines
    assert "stands at +2.000 V" in caplog.text
    output.write_V(3.0)
    bench.wait(0.51)
    assert bench.voltages_V == [2.0, 3.0, 0.0]


def test_a_module_that_was_silent_is_armed_again_since_it_may_have_lost_its_supply() -> None:
    bench = Bench()
    output = bench.open()
    output.write_V(1.0)
    bench.plugged = False
    with pytest.raises(InstrumentError, match="no answer"):
        output.write_V(1.1)
    bench.plugged = True
    bench.module.power_cycle()
    bench.lines.clear()
    output.keep_alive()
    assert bench.lines == [b"~010", b"~013105", b"~010", b"~**"]
    output.write_V(0.5)
    bench.wait(0.51)
    assert bench.voltages_V == [1.0, 0.0, 0.5, 0.0]


def test_a_checksum_is_added_to_every_line() -> None:
    bench = Bench(checksum=True)
    output = bench.open(checksum=True)
    output.write_V(1.0)
    output.keep_alive()
    # The bytes of ~** add up to 0x7E + 0x2A + 0x2A = 0xD2.
    assert bench.lines[-1] == b"~**D2"
    bench.wait(0.4)
    output.keep_alive()
    bench.wait(0.4)
    assert bench.voltages_V == [1.0]


def test_a_watchdog_trip_while_the_line_was_lost_is_found_and_stays_latched(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench()
    now_s = 0.0
    monkeypatch.setattr(icpdas_i7024, "open_link", partial(open_link, clock=lambda: now_s))
    wire = serve("socket://127.0.0.1:0", bench.module)
    url = wire.url
    output = icpdas_i7024.open_output(settings(url))
    try:
        output.write_V(1.0)
        wire.close()
        with pytest.raises(InstrumentError) as caught:
            output.write_V(1.1)
        assert caught.value.code == "hung_up"
        bench.wait(0.51)
        wire = serve(url, bench.module)
        now_s = RETRY_S
        with pytest.raises(InstrumentError) as caught:
            output.write_V(1.1)
        assert caught.value.code == "tripped"
        assert "it waits for a reset" in caplog.text
        assert "has not been tested with its instrument" in caplog.text
        output.clear_trip()
        output.write_V(0.25)
        assert bench.voltages_V == [1.0, 0.0, 0.25]
    finally:
        output.close()
        wire.close()
