"""An accepted reply belongs to its request, however late, lost or duplicated replies are.

Each simulated instrument states the time in its reply, so the age of each accepted value is known.
Time is virtual; ``test_late_answers_on_ports.py`` has the same tests over TCP and a pty.
"""

import random
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

from pincette.config import Output, Sensor
from pincette.instruments import icpdas_i7024, keyence_lkg, srs_dc205
from pincette.instruments.line.counts import LineCounts, counting
from pincette.instruments.line.serial_link import GRACE, LEAST_PATIENCE_S
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError
from pincette.sim.instruments import dc205
from pincette.sim.instruments.dc205 import SimulatedDC205
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.protocol import TERMINATOR, Instrument
from tests.contract.test_example_driver import open_sensor
from tests.support.delayed_answers import (
    Clock,
    DelayedPort,
    Delays,
    constant,
    drawn,
    single,
    virtual_ports,
)
from tests.support.example_lds import SimulatedLDS

URL = "/dev/virtual"
PERIOD_S = 0.02
TIMEOUTS_S = (0.1, 0.0058)
QUICK_S = 0.002
WRAP_S = 9.0
"""Largest time that a value can represent, in s."""


def since(clock: Clock) -> float:
    """Return the time that an instrument states, with the resolution of its display."""
    return round(clock.now_s % WRAP_S, 3)


@dataclass(slots=True)
class Driven:
    """A driver with its delayed instrument."""

    clock: Clock
    port: DelayedPort
    use: Callable[[], float]
    """Make one exchange and return the time at which the instrument replied."""
    timeout_s: float
    counts: LineCounts

    def age_s(self) -> float | None:
        """Make one exchange; returns the age of its reply, None if the driver raised."""
        try:
            stated_s = self.use()
        except InstrumentError:
            return None
        half_s = 0.5 * WRAP_S
        return (since(self.clock) - stated_s + half_s) % WRAP_S - half_s


class Stated:
    """A voltage output that records its voltages and their times."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.at_s: dict[float, float] = {}

    def put_out(self, voltage_V: float) -> None:
        self.at_s[round(voltage_V, 3)] = since(self.clock)


class Speaking:
    """A module that returns the time when its output voltage is read."""

    def __init__(self, module: SimulatedI7024, clock: Clock) -> None:
        self.module, self.clock = module, clock

    def idle(self) -> None:
        self.module.idle()

    def answer(self, line: bytes) -> bytes | None:
        """Set the channel right before it is read."""
        body = b"#010%+07.3f" % since(self.clock)
        checksum = b"%02X" % (sum(body) % 256) if self.module.checksum else b""
        if line.startswith(b"$018"):
            self.module.answer(body + checksum)
        return self.module.answer(line)


class SpeakingDC205:
    """A source whose setting is the time at which it is read."""

    def __init__(self, source: SimulatedDC205, clock: Clock) -> None:
        self.source, self.clock = source, clock

    def idle(self) -> None:
        pass

    def answer(self, line: bytes) -> bytes | None:
        if line.startswith(b"VOLT?"):
            self.source.answer(b"VOLT %.3f" % since(self.clock))
        return self.source.answer(line)


def sensor_settings(driver: str, timeout_s: float) -> Sensor:
    return Sensor(
        driver=driver,
        url=URL,
        minimum_um=-9999.0,
        maximum_um=9999.0,
        timeout_s=timeout_s,
        noise_um=0.03,
    )


def output_settings(driver: str, timeout_s: float, **options: str | float | bool) -> Output:
    return Output(driver=driver, url=URL, timeout_s=timeout_s, options=dict(options))


Open = Callable[[float], Callable[[], float]]
Made = tuple[Instrument, bytes, Open]


def keyence(clock: Clock) -> Made:
    def opened(timeout_s: float) -> Callable[[], float]:
        sensor = keyence_lkg.open_sensor(sensor_settings("keyence_lkg", timeout_s))
        return lambda: sensor.read_um() / 100.0

    return SimulatedKeyence(lambda: 100.0 * since(clock)), TERMINATOR, opened


def example_lds(clock: Clock) -> Made:
    def opened(timeout_s: float) -> Callable[[], float]:
        sensor = open_sensor(sensor_settings("example_lds", timeout_s), None)
        return lambda: sensor.read_um() / 100.0

    return SimulatedLDS(lambda: 100.0 * since(clock)), TERMINATOR, opened


class Plain:
    """An instrument that replies to each request with the time only."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock

    def idle(self) -> None:
        pass

    def answer(self, line: bytes) -> bytes:
        assert line
        return b"%.3f" % since(self.clock)


def plain(clock: Clock) -> Made:
    """Make a driver that does not state how its replies can be distinguished."""

    def opened(timeout_s: float) -> Callable[[], float]:
        line = open_link(URL, baud=115200, timeout_s=timeout_s)
        return lambda: float(line.exchange(b"POS?"))

    return Plain(clock), TERMINATOR, opened


def i7024_read(clock: Clock, *, checksum: bool = False) -> Made:
    def opened(timeout_s: float) -> Callable[[], float]:
        settings = output_settings("icpdas_i7024", timeout_s, watchdog_s=0.0, checksum=checksum)
        return icpdas_i7024.open_output(settings).read_V

    module = SimulatedI7024(lambda _voltage_V: None, clock.time, checksum=checksum)
    return Speaking(module, clock), TERMINATOR, opened


def i7024_read_with_checksum(clock: Clock) -> Made:
    return i7024_read(clock, checksum=True)


def writes(write_V: Callable[[float], None], stated: Stated) -> Callable[[], float]:
    """Write a new voltage each time; the age of the reply is that of the output voltage."""
    chance = random.Random(1)

    def use() -> float:
        voltage_V = round(chance.uniform(-9.0, 9.0), 3)
        stated.at_s.pop(voltage_V, None)
        write_V(voltage_V)
        return stated.at_s.get(voltage_V, stated.clock.now_s + 0.4 * WRAP_S)

    return use


def i7024_write(clock: Clock) -> Made:
    stated = Stated(clock)

    def opened(timeout_s: float) -> Callable[[], float]:
        settings = output_settings("icpdas_i7024", timeout_s, watchdog_s=0.0)
        return writes(icpdas_i7024.open_output(settings).write_V, stated)

    return SimulatedI7024(stated.put_out, clock.time), TERMINATOR, opened


def dc205_read(clock: Clock) -> Made:
    def opened(timeout_s: float) -> Callable[[], float]:
        source = srs_dc205.open_output(output_settings("srs_dc205", timeout_s))
        return lambda: source.read_V()

    source = SimulatedDC205(lambda _voltage_V: None)
    source.answer(b"RNGE RANGE10;SOUT 1")
    return SpeakingDC205(source, clock), dc205.TERMINATOR, opened


def dc205_write(clock: Clock) -> Made:
    stated = Stated(clock)

    def opened(timeout_s: float) -> Callable[[], float]:
        output = srs_dc205.open_output(output_settings("srs_dc205", timeout_s))
        return writes(output.write_V, stated)

    source = SimulatedDC205(stated.put_out)
    source.answer(b"RNGE RANGE10;SOUT 1")
    return source, dc205.TERMINATOR, opened


DRIVERS = (
    keyence,
    example_lds,
    plain,
    i7024_read,
    i7024_read_with_checksum,
    i7024_write,
    dc205_read,
    dc205_write,
)
every_driver = pytest.mark.parametrize("make", DRIVERS)
every_timeout = pytest.mark.parametrize("timeout_s", TIMEOUTS_S)


@contextmanager
def driven(make: Callable[[Clock], Made], timeout_s: float, **port: bool) -> Generator[Driven]:
    """Open a driver whose first exchanges get immediate replies."""
    clock, counts = Clock(), LineCounts()
    instrument, terminator, open_ = make(clock)
    behind = DelayedPort(clock, instrument, constant(QUICK_S / 4), terminator, **port)
    with virtual_ports({URL: behind}, clock), counting(counts):
        use = open_(timeout_s)
        yield Driven(clock, behind, use, timeout_s, counts)


def check_ages(driver: Driven, delays: Delays, times: int = 60) -> int:
    """Make one exchange each period and check that no late reply is accepted; returns the number
    accepted.

    A value states milliseconds.
    """
    driver.port.delays = delays
    accepted = 0
    for _ in range(times):
        began_s = driver.clock.now_s
        age_s = driver.age_s()
        took_s = driver.clock.now_s - began_s
        assert took_s <= driver.timeout_s * (1.0 + GRACE) + 1e-9
        if age_s is not None:
            accepted += 1
            assert -0.0011 <= age_s <= took_s + 0.0011
        driver.clock.now_s += max(0.001, PERIOD_S - took_s)
    return accepted


def check_recovers(driver: Driven) -> None:
    """Check that the driver works again, at the latest when the patience is over."""
    driver.port.delays = constant(QUICK_S / 4)
    until_s = driver.clock.now_s + 2.0 * max(LEAST_PATIENCE_S, 4.0 * driver.timeout_s)
    while driver.age_s() is None:
        assert driver.clock.now_s < until_s
        driver.clock.now_s += PERIOD_S
    assert check_ages(driver, constant(QUICK_S / 4), 5) == 5


@every_timeout
@every_driver
def test_equally_late_answers_are_never_assigned_to_another_request(
    make: Callable[[Clock], Made], timeout_s: float
) -> None:
    for tenths in (0, 6, 9, 11, 15, 30, 73, 172):
        with driven(make, timeout_s) as driver:
            accepted = check_ages(driver, constant(0.1 * tenths * timeout_s))
            assert accepted == 0 or tenths <= 10
            assert accepted or tenths > 9
            assert driver.counts.late or tenths <= 10 or make is not keyence
            check_recovers(driver)


@every_timeout
@every_driver
def test_randomly_late_answers_are_never_assigned_to_another_request(
    make: Callable[[Clock], Made], timeout_s: float
) -> None:
    for seed in range(3):
        for split in (False, True):
            with driven(make, timeout_s, split=split) as driver:
                lost = 0.1 * (seed % 3)
                print(f"seed {seed}, split {split}, lost {lost}")
                check_ages(driver, drawn(3.0 * timeout_s, seed, lost=lost), 150)
                check_recovers(driver)


@every_timeout
@every_driver
def test_one_late_answer_is_never_assigned_to_another_request(
    make: Callable[[Clock], Made], timeout_s: float
) -> None:
    for tenths in (8, 11, 21, 30):
        with driven(make, timeout_s) as driver:
            quick_s = min(QUICK_S, 0.2 * timeout_s)
            accepted = check_ages(driver, single(0.1 * tenths * timeout_s, 20, quick_s), 100)
            assert accepted > 50


@every_timeout
@every_driver
def test_after_missing_answers_no_answer_is_assigned_to_another_request(
    make: Callable[[Clock], Made], timeout_s: float
) -> None:
    for every in (3, 30):
        with driven(make, timeout_s) as driver:

            def delays(number: int, every: int = every) -> list[float]:
                return [] if number % every == every - 1 else [0.1 * timeout_s]

            accepted = check_ages(driver, delays, 200)
            if make is not plain:
                assert accepted > 60
            assert driver.counts.lost
            check_recovers(driver)


@every_timeout
@every_driver
def test_duplicated_answers_are_never_assigned_to_another_request(
    make: Callable[[Clock], Made], timeout_s: float
) -> None:
    with driven(make, timeout_s) as driver:
        check_ages(driver, lambda _number: [0.1 * timeout_s, 0.1 * timeout_s])
        check_recovers(driver)
    for seed in range(2):
        with driven(make, timeout_s) as driver:
            print(f"seed {seed}")
            check_ages(driver, drawn(2.0 * timeout_s, seed, lost=0.1, doubled=0.05), 150)


@pytest.mark.parametrize("survives", [True, False])
@every_timeout
@every_driver
def test_a_connection_is_lost_while_answers_are_pending(
    make: Callable[[Clock], Made],
    timeout_s: float,
    survives: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """``survives``: the old reply reaches the next connection, as with a serial server."""
    with driven(make, timeout_s, survives=survives) as driver:
        chance, receive = random.Random(5), DelayedPort.receive

        def breaking(port: DelayedPort, wait_s: float) -> bytes:
            if wait_s and chance.random() < 0.1:
                raise OSError("the other end has closed the connection")
            return receive(port, wait_s)

        with monkeypatch.context() as patch:
            patch.setattr(DelayedPort, "receive", breaking)
            check_ages(driver, drawn(3.0 * timeout_s, 1, lost=0.1), 300)
        check_recovers(driver)
