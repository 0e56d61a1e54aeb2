"""Over TCP and a pseudo-terminal an accepted reply belongs to its request, however late it is."""

import time
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, closing, contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from pincette.instruments import icpdas_i7024, keyence_lkg, srs_dc205
from pincette.instruments.line.counts import LineCounts, counting
from pincette.instruments.line.serial_link import GRACE, Line
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError
from pincette.sim.instruments import dc205
from pincette.sim.instruments.dc205 import SimulatedDC205
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.protocol import TERMINATOR, Instrument
from pincette.sim.wires.wire import serve
from tests.contract.test_example_driver import open_sensor
from tests.contract.test_late_answers import output_settings, sensor_settings
from tests.support.delayed_answers import Delays, constant, drawn, single
from tests.support.example_lds import SimulatedLDS

pytestmark = pytest.mark.usefixtures("stalls")

TIMEOUT_S = 0.02
OPENING_S = 10.0
"""Timeout while a driver opens its instrument, which is not measured here."""
WRAP_S = 9.0
UNCERTAIN_S = 0.002
"""Resolution of the time that an instrument states, in s, and of the measurement here."""


class Delayed:
    """An instrument that answers each request after a delay, one request after the other."""

    def __init__(
        self, instrument: Instrument, delays: Delays, terminator: bytes = TERMINATOR
    ) -> None:
        self.instrument, self.delays, self.terminator = instrument, delays, terminator
        self.number = 0

    def idle(self) -> None:
        self.instrument.idle()

    def answer(self, line: bytes) -> bytes | None:
        """Process the request at once, and reply late, twice or never."""
        reply = self.instrument.answer(line)
        delays_s = self.delays(self.number)
        self.number += 1
        if reply is None or not delays_s:
            return None
        time.sleep(delays_s[0])
        return self.terminator.join([reply] * len(delays_s))


def stated_s() -> float:
    return time.monotonic() % WRAP_S


@contextmanager
def laser(url: str, delays: Delays) -> Generator[Callable[[], float]]:
    instrument = Delayed(SimulatedKeyence(lambda: 100.0 * stated_s()), constant(0.0))
    with serve(url, instrument) as wire:
        settings = sensor_settings("keyence_lkg", OPENING_S).model_copy(update={"url": wire.url})
        sensor = keyence_lkg.open_sensor(settings)
        shorten(sensor.link, TIMEOUT_S)
        instrument.delays = delays
        yield lambda: sensor.read_um() / 100.0
        sensor.close()


@contextmanager
def module(url: str, delays: Delays) -> Generator[Callable[[], float]]:
    behind = SimulatedI7024(lambda _voltage_V: None, time.monotonic)

    class Clocked(Delayed):
        def answer(self, line: bytes) -> bytes | None:
            if line.startswith(b"$018"):
                behind.answer(b"#010%+07.3f" % stated_s())
            return super().answer(line)

    instrument = Clocked(behind, constant(0.0))
    with serve(url, instrument) as wire:
        settings = output_settings("icpdas_i7024", OPENING_S, watchdog_s=0.0)
        output = icpdas_i7024.open_output(settings.model_copy(update={"url": wire.url}))
        shorten(vars(output)["_link"], TIMEOUT_S)
        instrument.delays = delays
        yield output.read_V
        output.close()


@contextmanager
def module_write(url: str, delays: Delays) -> Generator[Callable[[], float]]:
    """Write a new voltage each time; the age of the reply is that of the output voltage."""
    reached_s: dict[float, float] = {}

    def put_out(voltage_V: float) -> None:
        reached_s[round(voltage_V, 3)] = stated_s()

    instrument = Delayed(SimulatedI7024(put_out, time.monotonic), constant(0.0))
    with serve(url, instrument) as wire:
        settings = output_settings("icpdas_i7024", OPENING_S, watchdog_s=0.0)
        output = icpdas_i7024.open_output(settings.model_copy(update={"url": wire.url}))
        shorten(vars(output)["_link"], TIMEOUT_S)
        yield from written(output.write_V, reached_s, instrument, delays)
        output.close()


@contextmanager
def source_write(url: str, delays: Delays) -> Generator[Callable[[], float]]:
    """Write to a DC205 in the same way."""
    reached_s: dict[float, float] = {}

    def put_out(voltage_V: float) -> None:
        reached_s[round(voltage_V, 3)] = stated_s()

    source = SimulatedDC205(put_out)
    source.answer(b"RNGE RANGE10;SOUT 1")
    instrument = Delayed(source, constant(0.0), dc205.TERMINATOR)
    with serve(url, instrument, terminator=dc205.TERMINATOR) as wire:
        settings = output_settings("srs_dc205", OPENING_S)
        output = srs_dc205.open_output(settings.model_copy(update={"url": wire.url}))
        shorten(vars(output)["_link"], TIMEOUT_S)
        yield from written(output.write_V, reached_s, instrument, delays)
        output.close()


@contextmanager
def source_read(url: str, delays: Delays) -> Generator[Callable[[], float]]:
    """Read a DC205 back, whose setting is the time at which it is read."""
    source = SimulatedDC205(lambda _voltage_V: None)
    source.answer(b"RNGE RANGE10;SOUT 1")

    class Clocked(Delayed):
        def answer(self, line: bytes) -> bytes | None:
            if line.startswith(b"VOLT?"):
                source.answer(b"VOLT %.6f" % stated_s())
            return super().answer(line)

    instrument = Clocked(source, constant(0.0), dc205.TERMINATOR)
    with serve(url, instrument, terminator=dc205.TERMINATOR) as wire:
        settings = output_settings("srs_dc205", OPENING_S)
        output = srs_dc205.open_output(settings.model_copy(update={"url": wire.url}))
        shorten(vars(output)["_link"], TIMEOUT_S)
        instrument.delays = delays
        yield output.read_V
        output.close()


@contextmanager
def third_party(url: str, delays: Delays) -> Generator[Callable[[], float]]:
    """Read the sensor of the driver example."""
    instrument = Delayed(SimulatedLDS(lambda: 100.0 * stated_s()), constant(0.0))
    with serve(url, instrument) as wire:
        settings = sensor_settings("example_lds", OPENING_S).model_copy(update={"url": wire.url})
        sensor: Any = open_sensor(settings, None)
        shorten(sensor.link, TIMEOUT_S)
        instrument.delays = delays
        yield lambda: sensor.read_um() / 100.0
        sensor.close()


class Plain:
    """An instrument that replies to each request with the time only."""

    def idle(self) -> None:
        pass

    def answer(self, line: bytes) -> bytes:
        assert line
        return b"%.4f" % stated_s()


@contextmanager
def third_party_without_patterns(url: str, delays: Delays) -> Generator[Callable[[], float]]:
    """Read through a line whose driver cannot assign a reply to its request."""
    instrument = Delayed(Plain(), delays)
    with (
        serve(url, instrument) as wire,
        closing(open_link(wire.url, baud=115200, timeout_s=TIMEOUT_S)) as line,
    ):
        yield lambda: float(line.exchange(b"POS?"))


def written(
    write_V: Callable[[float], None],
    reached_s: dict[float, float],
    instrument: Delayed,
    delays: Delays,
) -> Generator[Callable[[], float]]:
    """Yield an exchange that writes a unique voltage and returns the time when it reached the
    output."""
    numbers = count()

    def use() -> float:
        voltage_V = round(0.001 * (next(numbers) % 9000), 3)
        reached_s.pop(voltage_V, None)
        write_V(voltage_V)
        # A confirmed voltage that was never put out counts as too old.
        return reached_s.get(voltage_V, stated_s() - 0.4 * WRAP_S)

    instrument.delays = delays
    yield use


def shorten(link: object, timeout_s: float) -> None:
    """Shorten the timeout of a line that has been opened."""
    assert isinstance(link, Line)
    link.timeout_s = timeout_s


def check_ages(use: Callable[[], float], for_s: float) -> tuple[int, int]:
    """Make exchanges for a while; returns how many were accepted and how many were not."""
    accepted = refused = 0
    until_s = time.monotonic() + for_s
    while time.monotonic() < until_s:
        began_s = time.monotonic()
        try:
            answered_s = use()
        except InstrumentError:
            refused += 1
            continue
        now_s = time.monotonic()
        age_s = (now_s - answered_s + 0.5 * WRAP_S) % WRAP_S - 0.5 * WRAP_S
        assert age_s <= now_s - began_s + UNCERTAIN_S
        accepted += 1
    return accepted, refused


INSTRUMENTS = pytest.mark.parametrize("offer", [laser, module, module_write, source_write])
THIRD = pytest.mark.parametrize("offer", [source_read, third_party, third_party_without_patterns])
PORTS = pytest.mark.parametrize("port", ["tcp", "pty"])
Offer = Callable[[str, Delays], AbstractContextManager[Callable[[], float]]]


def url_of(port: str, folder: Path) -> str:
    return "socket://127.0.0.1:0" if port == "tcp" else str(folder / "port")


@PORTS
@INSTRUMENTS
def test_answers_later_than_their_timeout_are_never_accepted(
    offer: Offer, port: str, tmp_path: Path
) -> None:
    counts = LineCounts()
    late = constant((1.3 + GRACE) * TIMEOUT_S)
    with counting(counts), offer(url_of(port, tmp_path), late) as use:
        accepted, refused = check_ages(use, 0.3)
    assert accepted == 0
    assert refused
    assert counts.late


@PORTS
@INSTRUMENTS
def test_answers_may_be_late_lost_or_duplicated_at_random(
    offer: Offer, port: str, tmp_path: Path
) -> None:
    seed = 20261127
    print(f"seed {seed}")
    delays = drawn(1.5 * TIMEOUT_S, seed, lost=0.05, doubled=0.05)
    with offer(url_of(port, tmp_path), delays) as use:
        accepted, _ = check_ages(use, 0.5)
    assert accepted


@PORTS
@THIRD
def test_late_answers_of_an_output_are_never_assigned_to_another_request(
    offer: Offer, port: str, tmp_path: Path
) -> None:
    """First all replies are late, then they are late, lost or duplicated at random."""
    late = constant((1.3 + GRACE) * TIMEOUT_S)
    with offer(url_of(port, tmp_path), late) as use:
        _, refused = check_ages(use, 0.5)
    assert refused
    seed = 20261127
    print(f"seed {seed}")
    delays = drawn(1.5 * TIMEOUT_S, seed, lost=0.05, doubled=0.05)
    with offer(url_of(port, tmp_path), delays) as use:
        accepted, _ = check_ages(use, 3.0)
    assert accepted


@PORTS
@INSTRUMENTS
def test_answers_with_any_delay_up_to_three_timeouts_are_assigned_correctly(
    offer: Offer, port: str, tmp_path: Path
) -> None:
    """The whole table (long)."""
    for tenths in range(31):
        delay_s = 0.1 * tenths * TIMEOUT_S
        for kind, delays in (
            ("constant", constant(delay_s)),
            ("random", drawn(delay_s, tenths, lost=0.05)),
            ("single", single(delay_s, 7, 0.0)),
        ):
            print(f"{tenths} tenths of the timeout, {kind}")
            with offer(url_of(port, tmp_path), delays) as use:
                check_ages(use, 0.5)
