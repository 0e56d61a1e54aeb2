"""The instruments of a service: opens their drivers, reads them, writes voltages and waves."""

import logging
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from math import ceil, inf
from time import monotonic, sleep
from typing import Any, TypeVar

from pincette.config import ConfigError, RigFile
from pincette.core import plugins
from pincette.core.faults import Fault, FaultCode, fault
from pincette.core.messages import Message
from pincette.core.messages.requests import ExchangeTimes
from pincette.core.service import (
    Acquired,
    AnyService,
    ArmReading,
    CheckWave,
    DeviceCommand,
    ReadBack,
    RefusedError,
    SetVoltage,
    Wave,
    WriteParts,
)
from pincette.engine.exchange_times import ExchangeRecorder
from pincette.instruments.line.counts import LineCounts, current_counts
from pincette.instruments.line.shared_line import one_line_for_each_url
from pincette.instruments.protocols import (
    Block,
    BufferedSensor,
    InstrumentError,
    PartsOutput,
    PositionSensor,
    VoltageOutput,
    WatchedOutput,
    WaveOutput,
)

Device = PositionSensor | VoltageOutput | tuple[PositionSensor | VoltageOutput, ...] | None
"""Device of a service; on a rig of two arms a tuple with one for each arm."""


def of_arms(devices: Sequence[PositionSensor | VoltageOutput]) -> Device:
    """Return the device of a service, or a tuple of both on a rig of two arms."""
    return tuple(devices) if len(devices) > 1 else devices[0]


ORDERS = (SetVoltage, WriteParts, Wave, CheckWave, ReadBack)
"""Types of outputs of a step that are commands to the instrument."""
MOST_SAMPLES = 3000
"""Largest number of samples of an acquisition in one tick; if the loop was late, the rest follows
in later ticks."""
LEAST_READING_S = 0.005
"""Shortest upper limit for the duration of a reading, in s. If the machine stalls for less than
this, a reading does not count as too old.
"""
WAITED_SHARE = 0.8
"""Fraction of the longest reading time for which the service waits for a sensor."""
NO_PARTS = (
    "this voltage output cannot write steps in parts, since it has no clock of its own: "
    "omit [output] shaping, and fit an RC of 3.3 ms before the amplifier"
)
TRIES = 3
"""Number of attempts to open an instrument, or to read back its voltage."""
PAUSE_S = 0.05
"""Pause in s before another attempt if the reply was not valid, since noise on the line may
continue."""
QUESTIONS = 5
"""Number of queries to the output that are measured at each arming."""
REOPEN_PERIODS = 1.5
"""Longest time, in control periods, in which a lost line to an output may be reopened without a
fault."""
SAME_V = 0.01
"""Largest difference between two voltages, in V, that is attributed to rounding."""
PASSING = ("silent", "late", "garbled")
"""Failures of an exchange that may succeed when it is repeated."""


@dataclass(frozen=True, slots=True)
class ReadingWatch:
    """Refuses readings that took too long.

    The instrument may have measured at the beginning of the exchange. With a position that is older
    than a control period, the arm may press a part for longer before the loop reacts.
    """

    oldest_s: float
    """Longest time that a reading may take, in s."""
    clock: Callable[[], float] = monotonic

    def too_old(self, began_s: float) -> ArmReading | None:
        """Return a fault if a reading took too long, else None."""
        took_s = self.clock() - began_s
        if took_s <= self.oldest_s:
            return None
        words = (
            f"the reading took {1000.0 * took_s:.1f} ms, limit {1000.0 * self.oldest_s:g} "
            "ms: find what delays the line, or choose a longer [rig] period_s"
        )
        return ArmReading(0.0, fault(FaultCode.INSTRUMENT_LATE, words, took_s=took_s))


class Instrument:
    """The instrument of one arm; failures are returned as faults, never raised as exceptions."""

    def __init__(
        self,
        device: PositionSensor | VoltageOutput | None,
        period_s: float,
        watch: ReadingWatch | None,
        counts: LineCounts | None = None,
        *,
        arm: int = 0,
    ) -> None:
        """Take a device.

        Parameters
        ----------
        arm
            Index of the arm in a command for all arms.
        """
        self._arm = arm
        self.counts = LineCounts() if counts is None else counts
        self._watch = watch
        """Watch of readings; None in lockstep, where they take no time."""
        self._recorder = ExchangeRecorder()
        self._device: Any = device
        self._watched = device if isinstance(device, WatchedOutput) else None
        """True if the output has a watchdog; checked only once, since the check takes long."""
        self._period_s = period_s
        self._kicked_at_s = 0.0
        self._confirmed_V: float | None = None
        """Last voltage that the output confirmed, in V; None before the first one and after a
        fault."""
        self._capture_hz = 0.0
        self._later = Block((), ())

    def read(self) -> ArmReading:
        """Read the sensor: one reading, or all samples acquired since the last tick."""
        watch = self._watch
        try:
            if not self._capture_hz:
                if watch is None:
                    return ArmReading(self._device.read_um())
                began_s = watch.clock()
                x_um = self._device.read_um()
                self._recorder.add(watch.clock() - began_s)
                return watch.too_old(began_s) or ArmReading(x_um)
            block = self._device.read_block()
        except Exception as error:  # noqa: BLE001  a driver from outside may raise anything
            return ArmReading(0.0, fault_of(error))
        if not block.x_um:
            return ArmReading(0.0, fault(FaultCode.NO_ACQUISITION))
        x_um, drive_V = (*self._later.x_um, *block.x_um), (*self._later.drive_V, *block.drive_V)
        self._later = Block(x_um[MOST_SAMPLES:], drive_V[MOST_SAMPLES:])
        acquired = Acquired(self._capture_hz, x_um[:MOST_SAMPLES], drive_V[:MOST_SAMPLES])
        return ArmReading(block.x_um[-1], acquired=acquired)

    def put_out(self, order: DeviceCommand) -> Fault | float | None:
        """Send the output its command; return its fault, or the voltage that it has read back."""
        confirmed_V, self._confirmed_V = self._confirmed_V, None
        try:
            if isinstance(order, SetVoltage):
                voltage_V = order.voltages_V[self._arm]
                write = partial(self._device.write_V, voltage_V)
                began_s = self._done_again(write, confirmed_V, voltage_V)
                if began_s is not None:
                    self._note_exchange(began_s)
                self._confirmed_V = voltage_V
            elif isinstance(order, WriteParts):
                if not isinstance(self._device, PartsOutput):
                    return fault(FaultCode.INSTRUMENT_MISUSED, NO_PARTS)
                began_s = self._now_s()
                self._device.write_parts(order.voltages_V, order.interval_s)
                self._note_exchange(began_s)
            elif isinstance(order, ReadBack):
                self._confirmed_V = found_V = float(self._device.read_V())
                return found_V
            elif not isinstance(self._device, WaveOutput):
                words = "the voltage output cannot play waves: it has no buffer"
                return fault(FaultCode.INSTRUMENT_MISUSED, words)
            elif isinstance(order, Wave):
                self._device.begin_wave(order.voltages_V, order.rate_hz)
            else:
                self._device.look()
        except Exception as error:  # noqa: BLE001  a driver from outside may raise anything
            return fault_of(error)
        return None

    @property
    def watched(self) -> bool:
        """True if the output has a watchdog that needs heartbeats."""
        return self._watched is not None

    def keep_alive(self, now: float) -> Fault | None:
        """Send a heartbeat to a watched output once a period; return its fault."""
        if self._watched is None or now - self._kicked_at_s < self._period_s:
            return None
        self._kicked_at_s = now
        try:
            self._done_again(self._watched.keep_alive, self._confirmed_V)
        except Exception as error:  # noqa: BLE001  a driver from outside may raise anything
            return fault_of(error)
        return None

    def _done_again(self, act: Callable[[], None], *expected_V: float | None) -> float | None:
        """Call the driver; repeat the call once if the line was lost and the output has kept its
        voltage.

        A device server that closes the connection, or is restarted, does not change the output. The
        voltage is therefore read back over the new connection. Only an expected voltage is
        accepted: an output that lost its supply or tripped has another one. Returns the time at
        which the call began; None if it was repeated.
        """
        began_s = self._now_s()
        try:
            act()
        except Exception as error:
            watch, found = self._watch, driver_error(error)
            if watch is None or found.code != "hung_up" or expected_V[0] is None:
                raise
            try:
                found_V = float(self._device.read_V())
            except Exception:  # noqa: BLE001  a driver from outside may raise anything
                raise error from None
            known = any(one is not None and abs(found_V - one) < SAME_V for one in expected_V)
            took_s = watch.clock() - began_s
            if not known or took_s > REOPEN_PERIODS * self._period_s:
                raise
            self.counts.retried += 1
            _log.warning("%s; it keeps %.3f V, and continues after %.3f s", found, found_V, took_s)
            act()
            return None
        return began_s

    def recover(self) -> float:
        """Clear the trip of a watched output for a reset, and return its voltage."""
        try:
            if self._watched is not None:
                self._watched.clear_trip()
        except Exception as error:
            found = driver_error(error)
            raise RefusedError(f"the voltage output cannot be reset: {found}") from error
        return self.read_back()

    def read_back(self) -> float:
        """Return the output's voltage; raises RefusedError if the output does not state it.

        After a wrong reply the query is repeated, since reading moves nothing.
        """
        try:
            return float(self._read_back())
        except Exception as error:
            found = driver_error(error)
            raise RefusedError(f"the voltage output cannot be read back: {found}") from error

    def measure(self) -> None:
        """Read the output's voltage a few times to measure the duration of exchanges; moves
        nothing.

        A failed query is ignored, since the output has just been read back successfully.
        """
        if self._watch is None:
            return
        for _ in range(QUESTIONS):
            began_s = self._now_s()
            with suppress(Exception):
                self._device.read_V()
                self._note_exchange(began_s)

    @property
    def exchanges(self) -> ExchangeTimes | None:
        """Return the durations of the newest exchanges with the instrument.

        None before the first.
        """
        return self._recorder.times()

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
                # A device server may have closed a connection that was unused for a long time.
                if found.code not in (*PASSING, "hung_up"):
                    raise
                self.counts.retried += 1
                _log.warning("%s; it is read back again", found)
        return self._device.read_V()

    def capture(self, rate_hz: float) -> None:
        """Begin a buffered acquisition, or end the present one (0 Hz); raises RefusedError."""
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
        """Close the device."""
        if self._device is not None:
            self._device.close()


def published(outputs: tuple[Any, ...]) -> tuple[Message, ...]:
    """Return the outputs of a step, without a first one that is a command to the instrument."""
    return outputs[1:] if outputs and isinstance(outputs[0], ORDERS) else outputs


def driver_error(error: Exception) -> InstrumentError:
    """Return a driver's exception as an InstrumentError.

    An exception of any other class, such as the ValueError of an external driver, counts as a reply
    that the driver could not read.
    """
    if isinstance(error, InstrumentError):
        return error
    _log.debug("a driver raised", exc_info=error)
    text = f"the driver raised {type(error).__name__}: {error}; report it to the driver's author"
    return InstrumentError(text, "garbled")


def fault_of(error: Exception) -> Fault:
    """Return the fault for a driver's exception; its text is that of the driver."""
    found = driver_error(error)
    return fault(FaultCode(f"instrument_{found.code}"), str(found))


MEASUREMENT_TIMEOUT_S = 1.0
"""Timeout of an exchange that is measured while no loop runs, in s."""
LOCKSTEP_TIMEOUT_S = 2.0
"""Timeout in lockstep, in s of the wall clock: it ends a run that hangs, but never a tick."""

D = TypeVar("D", PositionSensor, VoltageOutput)

_log = logging.getLogger(__name__)


def open_for_measurement(service: AnyService, rig: RigFile) -> Device:
    """Open the instrument of a service for one arm, with a timeout that allows slow exchanges."""
    return _open(service, rig, inf, MEASUREMENT_TIMEOUT_S)


def open_device(service: AnyService, rig: RigFile, at_most_s: float = inf) -> Device:
    """Open a service's instrument, a sensor within ``at_most_s``; None if the service has none.

    The instruments of all arms are opened, or none stays open; at one url they share a line.
    """
    if len(rig.arms) == 1:
        return _open(service, rig.arms[0], at_most_s)
    opened: list[PositionSensor | VoltageOutput] = []
    with one_line_for_each_url(), ExitStack() as stack:
        for arm in rig.arms:
            device = _open(service, arm, at_most_s)
            if device is None:
                return None
            stack.callback(device.close)
            opened.append(device)
        stack.pop_all()
    return of_arms(opened)


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
        opened = _retried(partial(output, settings), TRIES)
        if isinstance(opened, WaveOutput):
            # A sweep begins within a tick, which is too short to import NumPy.
            import_module("pincette.control.planning.swept_voltages")
        if settings.shaping and not isinstance(opened, PartsOutput):
            opened.close()
            raise ConfigError(
                f"output.driver = {settings.driver!r} with shaping = true: {NO_PARTS}"
            )
        return opened
    return None


def longest_reading_s(period_s: float) -> float:
    """Return the age up to which a reading is accepted at a control period, in s."""
    return max(period_s, LEAST_READING_S)


def reading_timeout_s(rig: RigFile, at_most_s: float = inf) -> float:
    """Return the timeout of one arm's sensor, in s.

    The timeout ends before the next tick, which would otherwise be skipped.
    """
    tick_s = WAITED_SHARE * longest_reading_s(rig.rig.period_s)
    return min(rig.sensor.timeout_s, at_most_s, tick_s)


def _retried(open_: Callable[[], D], times: int) -> D:
    """Open an instrument in at most ``times`` attempts.

    If all programs of a rig start at once, the first reply may be late; and plugging a line in
    causes noise.
    """
    # A sensor with a short timeout in a tick may need several attempts for its first exchange.
    for _ in range(times - 1):
        try:
            return open_()
        except ConfigError:
            raise
        except Exception as error:  # noqa: BLE001  a driver from outside may raise anything
            found = driver_error(error)
            current_counts().retried += 1
            _log.warning("%s; the next attempt follows", found)
            if found.code == "garbled":
                sleep(PAUSE_S)
    try:
        return open_()
    except ConfigError:
        raise
    except Exception as error:
        raise driver_error(error) from error
