"""The instruments of a service: opened by their drivers, read, and given voltages and waves."""

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import ceil, inf
from time import monotonic, sleep
from typing import Any, NamedTuple, TypeVar

from pincette.config import ConfigError, RigFile
from pincette.core import plugins
from pincette.core.faults import Fault, FaultCode, fault
from pincette.core.messages import Message
from pincette.core.messages.requests import ExchangeTimes
from pincette.core.service import (
    Acquired,
    AnyService,
    CheckWave,
    DeviceCommand,
    PutOut,
    ReadBack,
    Reading,
    RefusedError,
    SetVoltage,
    Wave,
)
from pincette.engine.exchange_times import ExchangeRecorder
from pincette.instruments.line.counts import LineCounts, current_counts
from pincette.instruments.line.shared_line import one_line_for_each_url
from pincette.instruments.protocols import (
    Block,
    BufferedSensor,
    InstrumentError,
    PositionSensor,
    VoltageOutput,
    WatchedOutput,
    WaveOutput,
)


class Both(NamedTuple):
    """The instruments of two arms that one service has."""

    first: PositionSensor | VoltageOutput
    second: PositionSensor | VoltageOutput


Device = PositionSensor | VoltageOutput | Both | None


def of_arms(devices: Sequence[PositionSensor | VoltageOutput]) -> Device:
    """The device of a service, or both where there are two arms."""
    first, *others = devices
    return Both(first, others[0]) if others else first


ORDERS = (SetVoltage, Wave, CheckWave, ReadBack)
"""Outputs of a service that are for the instrument."""
MOST_SAMPLES = 3000
"""Of an acquisition, in one tick; where the loop was late, the rest follows in the next ones."""
LEAST_READING_S = 0.005
"""Time that a reading may take at any control period, in s: a machine that stands still so long
does not make a reading old."""
WAITED_SHARE = 0.8
"""Share of that time for which a sensor is waited for."""
TRIES = 3
"""Attempts to open an instrument, or to read back its voltage, before that has failed."""
PAUSE_S = 0.05
"""Pause before another attempt where bytes came that were no answer, in s: noise may last."""
QUESTIONS = 5
"""Number of questions to the output at each arming."""
PASSING = ("silent", "late", "garbled")
"""How an exchange fails that may succeed when it is repeated."""


@dataclass(frozen=True, slots=True)
class ReadingWatch:
    """Refuses readings that took too long.

    The instrument may have measured at the begin of the exchange. A position that is older than a
    control period would let the arm press on for that time.
    """

    oldest_s: float
    """Longest time that a reading may take, in s."""
    clock: Callable[[], float] = monotonic

    def too_old(self, began_s: float) -> Reading | None:
        """Return a fault in place of a reading that took too long; None where it did not."""
        took_s = self.clock() - began_s
        if took_s <= self.oldest_s:
            return None
        words = (
            f"the reading took {1e3 * took_s:.1f} ms, limit {1e3 * self.oldest_s:g} ms: find what "
            "delays the line, or take a longer [rig] period_s"
        )
        return Reading(0.0, fault(FaultCode.INSTRUMENT_LATE, words, took_s=took_s))


class Instrument:
    """What a node does with its device; each fault comes back as words, never as an exception."""

    def __init__(
        self,
        device: Device,
        period_s: float,
        watch: ReadingWatch | None,
        counts: LineCounts | None = None,
    ) -> None:
        self.counts = LineCounts() if counts is None else counts
        self._watch = watch
        """None in lockstep, where readings take no time."""
        self._recorder = ExchangeRecorder()
        self._device: Any = device
        self._watched = device if isinstance(device, WatchedOutput) else None
        """Looked at once: it takes long to see whether an object has all that a protocol asks."""
        self._period_s = period_s
        self._kicked_at_s = 0.0
        self._capture_hz = 0.0
        self._later = Block((), ())

    def read(self) -> Reading:
        """Read the sensor: once, or all that it has acquired since the last tick."""
        watch = self._watch
        try:
            if not self._capture_hz:
                if watch is None:
                    return Reading(self._device.read_um())
                began_s = watch.clock()
                x_um = self._device.read_um()
                self._recorder.add(watch.clock() - began_s)
                return watch.too_old(began_s) or Reading(x_um)
            block = self._device.read_block()
        except Exception as error:  # noqa: BLE001  a driver from outside may raise anything
            return Reading(0.0, fault_of(error))
        if not block.x_um:
            return Reading(0.0, fault(FaultCode.NO_ACQUISITION))
        x_um, drive_V = (*self._later.x_um, *block.x_um), (*self._later.drive_V, *block.drive_V)
        self._later = Block(x_um[MOST_SAMPLES:], drive_V[MOST_SAMPLES:])
        acquired = Acquired(self._capture_hz, x_um[:MOST_SAMPLES], drive_V[:MOST_SAMPLES])
        return Reading(block.x_um[-1], acquired=acquired)

    def put_out(self, order: DeviceCommand) -> Fault | PutOut | None:
        """Give the output its order; returns its fault, or the voltage that it was asked for."""
        try:
            if isinstance(order, SetVoltage):
                began_s = self._now_s()
                self._device.write_V(order.voltage_V)
                self._note_exchange(began_s)
            elif isinstance(order, ReadBack):
                return PutOut(self._device.read_V())
            elif not isinstance(self._device, WaveOutput):
                words = "the voltage output plays no waves: it has no buffer"
                return fault(FaultCode.INSTRUMENT_MISUSED, words)
            elif isinstance(order, Wave):
                self._device.begin_wave(order.voltages_V, order.rate_hz)
            else:
                self._device.look()
        except Exception as error:  # noqa: BLE001  a driver from outside may raise anything
            return fault_of(error)
        return None

    def keep_alive(self, now: float) -> Fault | None:
        """Once a period, say to a watched output that its host lives; returns its fault."""
        if self._watched is None or now - self._kicked_at_s < self._period_s:
            return None
        self._kicked_at_s = now
        try:
            self._watched.keep_alive()
        except Exception as error:  # noqa: BLE001  a driver from outside may raise anything
            return fault_of(error)
        return None

    def recover(self) -> PutOut:
        """For a reset: clear a watched output's trip, and return what is put out."""
        try:
            if self._watched is not None:
                self._watched.clear_trip()
        except Exception as error:
            found = driver_error(error)
            raise RefusedError(f"the voltage output cannot be reset: {found}") from error
        return self.read_back()

    def read_back(self) -> PutOut:
        """Return the voltage that is put out; raises RefusedError where the output does not say.

        One wrong answer does not count: reading moves nothing, so it is tried again.
        """
        try:
            return PutOut(float(self._read_back()))
        except Exception as error:
            found = driver_error(error)
            raise RefusedError(f"the voltage output cannot be read back: {found}") from error

    def measure(self) -> None:
        """Ask the output a few times for its voltage, which moves nothing, to measure exchanges.

        A question that fails is left out: the output has just been read back.
        """
        if self._watch is None:
            return
        for _ in range(QUESTIONS):
            began_s = self._now_s()
            with suppress(Exception):
                self._device.read_V()
                self._note_exchange(began_s)

    @property
    def exchanges(self) -> tuple[ExchangeTimes, ...]:
        """What the newest exchanges with the instrument took, for each arm; empty before."""
        times = self._recorder.times()
        return () if times is None else (times,)

    def _now_s(self) -> float:
        return 0.0 if self._watch is None else self._watch.clock()

    def _note_exchange(self, began_s: float) -> None:
        if self._watch is not None:
            self._recorder.add(self._watch.clock() - began_s)

    def _read_back(self) -> float:
        for _ in range(TRIES - 1):
            try:
                return self._device.read_V()
            except Exception as error:
                found = driver_error(error)
                if found.code not in PASSING:
                    raise
                self.counts.retried += 1
                _log.warning("%s; it is read back again", found)
        return self._device.read_V()

    def capture(self, rate_hz: float) -> None:
        """Begin a buffered acquisition, or end the one there is (0 Hz); raises RefusedError."""
        if not rate_hz and not self._capture_hz:
            return
        if not isinstance(self._device, BufferedSensor):
            raise RefusedError("the position sensor has no buffered acquisition")
        try:
            self._device.end_capture()
            self._capture_hz, self._later = 0.0, Block((), ())
            if rate_hz:
                self._device.begin_capture(rate_hz)
                self._capture_hz = rate_hz
        except Exception as error:
            found = driver_error(error)
            raise RefusedError(f"buffered acquisition at {rate_hz:g} Hz: {found}") from error

    def close(self) -> None:
        """Give the device back."""
        if self._device is not None:
            self._device.close()


def published(outputs: tuple[Message | DeviceCommand, ...]) -> tuple[Message, ...]:
    """Outputs without what was for the instrument."""
    return tuple([output for output in outputs if not isinstance(output, ORDERS)])


def driver_error(error: Exception) -> InstrumentError:
    """Return a driver's exception as an instrument's error.

    An exception of any other class, such as the ValueError of a driver from outside, counts as an
    answer that the driver could not read.
    """
    if isinstance(error, InstrumentError):
        return error
    _log.debug("a driver raised", exc_info=error)
    text = f"the driver raised {type(error).__name__}: {error}; report it to the driver's author"
    return InstrumentError(text, "garbled")


def fault_of(error: Exception) -> Fault:
    """Return the fault for a driver's exception, in the driver's own words."""
    found = driver_error(error)
    return fault(FaultCode(f"instrument_{found.code}"), str(found))


MEASUREMENT_TIMEOUT_S = 1.0
"""Longest time of an exchange that is measured while no loop runs, in s."""
LOCKSTEP_TIMEOUT_S = 2.0
"""By the clock on the wall, which in lockstep shall end a run that hangs, never a tick."""

D = TypeVar("D", PositionSensor, VoltageOutput)

_log = logging.getLogger(__name__)


def open_for_measurement(service: AnyService, rig: RigFile) -> Device:
    """Open the instrument of a service of one arm with a timeout that hides no slow exchange."""
    return _open(service, rig, inf, MEASUREMENT_TIMEOUT_S)


def open_device(service: AnyService, rig: RigFile, at_most_s: float = inf) -> Device:
    """Open a service's instrument, a sensor within ``at_most_s``; None if it has none.

    On a rig of two arms both are opened, or none stays open; at one url they share a line.
    """
    first, *others = rig.arms
    if not others:
        return _open(service, first, at_most_s)
    with one_line_for_each_url():
        return _open_both(service, first, others[0], at_most_s)


def _open_both(service: AnyService, first: RigFile, second: RigFile, at_most_s: float) -> Device:
    one = _open(service, first, at_most_s)
    if one is None:
        return None
    try:
        two = _open(service, second, at_most_s)
    except BaseException:
        one.close()
        raise
    return None if two is None else Both(one, two)


def _open(
    service: AnyService, rig: RigFile, at_most_s: float, timeout_s: float | None = None
) -> PositionSensor | VoltageOutput | None:
    """Open an instrument; ``timeout_s`` replaces the timeouts of the loop."""
    timeout_s = LOCKSTEP_TIMEOUT_S if rig.lockstep else timeout_s
    patience = {} if timeout_s is None else {"timeout_s": timeout_s}
    if service.instrument == "position_sensor":
        patience = patience or {"timeout_s": reading_timeout_s(rig, at_most_s)}
        settings = rig.sensor.model_copy(update=patience)
        sensor = plugins.load(plugins.POSITION_SENSORS, settings.driver)
        times = max(TRIES, ceil(rig.sensor.timeout_s / settings.timeout_s))
        return _retried(partial(sensor, settings), times)
    if service.instrument == "voltage_output":
        settings = rig.output.model_copy(update=patience)
        output = plugins.load(plugins.VOLTAGE_OUTPUTS, settings.driver)
        return _retried(partial(output, settings), TRIES)
    return None


def longest_reading_s(period_s: float) -> float:
    """Return the age up to which a reading is accepted at a control period, in s."""
    return max(period_s, LEAST_READING_S)


def reading_timeout_s(rig: RigFile, at_most_s: float = inf) -> float:
    """Return how long one arm's sensor is waited for, in s.

    After a timeout there is time left before the next tick, which would else be skipped.
    """
    tick_s = WAITED_SHARE * longest_reading_s(rig.rig.period_s)
    return min(rig.sensor.timeout_s, at_most_s, tick_s)


def _retried(open_: Callable[[], D], times: int) -> D:
    """Open an instrument in at most ``times`` attempts.

    Where all programs of a rig start at once, the first answer may be late; a line that is being
    plugged in makes noise.
    """
    # A sensor with a short timeout in a tick needs more of them to answer its first exchange.
    for _ in range(times - 1):
        try:
            return open_()
        except ConfigError:
            raise
        except Exception as error:  # noqa: BLE001  a driver from outside may raise anything
            found = driver_error(error)
            current_counts().retried += 1
            _log.warning("%s; it is tried again", found)
            if found.code == "garbled":
                sleep(PAUSE_S)
    try:
        return open_()
    except ConfigError:
        raise
    except Exception as error:
        raise driver_error(error) from error
