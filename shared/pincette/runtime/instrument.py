"""The instrument of a service: readings and acquisitions out of it, voltages and waves into it."""

from typing import cast

from pincette.instruments.protocols import (
    Block,
    BufferedSensor,
    InstrumentError,
    PositionSensor,
    VoltageOutput,
    WatchedOutput,
    WaveOutput,
)
from pincette.service import Acquired, Drive, ForInstrument, Reading, RefusedError, Wave

Device = PositionSensor | VoltageOutput | None

MOST_SAMPLES = 3000
"""Of an acquisition, in one tick; where the loop was late, the rest follows in the next ones."""


class Instrument:
    """What a node does with its device; each fault comes back as words, never as an exception."""

    def __init__(self, device: Device, period_s: float) -> None:
        self._device = device
        self._watched = device if isinstance(device, WatchedOutput) else None
        """Looked at once: it takes long to see whether an object has all that a protocol asks."""
        self._period_s = period_s
        self._fed_at = 0.0
        self._capture_hz = 0.0
        self._later = Block((), ())

    def read(self) -> Reading:
        """Read the sensor: once, or all that it has acquired since the last tick."""
        try:
            if not self._capture_hz:
                return Reading(cast(PositionSensor, self._device).read_um())
            block = cast(BufferedSensor, self._device).read_block()
        except InstrumentError as error:
            return Reading(0.0, str(error))
        if not block.x_um:
            return Reading(0.0, "the buffered acquisition has brought no sample")
        x_um, drive_V = (*self._later.x_um, *block.x_um), (*self._later.drive_V, *block.drive_V)
        self._later = Block(x_um[MOST_SAMPLES:], drive_V[MOST_SAMPLES:])
        acquired = Acquired(self._capture_hz, x_um[:MOST_SAMPLES], drive_V[:MOST_SAMPLES])
        return Reading(block.x_um[-1], acquired=acquired)

    def put_out(self, order: ForInstrument) -> str:
        """Give the output its order; returns its fault."""
        try:
            if isinstance(order, Drive):
                cast(VoltageOutput, self._device).write_V(order.voltage_V)
            elif not isinstance(self._device, WaveOutput):
                return "the voltage output plays no waves: it has no buffer"
            elif isinstance(order, Wave):
                self._device.begin_wave(order.voltages_V, order.rate_hz)
            else:
                self._device.look()
        except InstrumentError as error:
            return str(error)
        return ""

    def keep_alive(self, now: float) -> str:
        """Once a period, say to a watched output that its host lives; returns its fault."""
        if self._watched is None or now - self._fed_at < self._period_s:
            return ""
        self._fed_at = now
        try:
            self._watched.keep_alive()
        except InstrumentError as error:
            return str(error)
        return ""

    def recover(self) -> float | None:
        """After a person's reset: clear a watched output's trip; the voltage it puts out then.

        None where the output is not watched: it stands where it was told to.

        Raises
        ------
        RefusedError
            Where the output does not answer.
        """
        if self._watched is None:
            return None
        try:
            self._watched.clear_trip()
            return self._watched.read_V()
        except InstrumentError as error:
            raise RefusedError(f"the voltage output cannot be reset: {error}") from error

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
        except InstrumentError as error:
            raise RefusedError(f"buffered acquisition at {rate_hz:g} Hz: {error}") from error

    def close(self) -> None:
        """Give the device back."""
        if self._device is not None:
            self._device.close()
