"""Simulated NI-DAQmx task: channels, timing and buffers, and its effect on the rig.

Statuses are NI's. Assumed without a source: the device has ±10 V and 16 bit in both directions,
samples its inputs at one instant, and reads 0 V where nothing is connected; a buffered output that
is stopped holds its last voltage.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from nidaqmx.constants import AcquisitionType
from nidaqmx.error_codes import DAQmxErrors

LIMIT_V = 10.0
STEP_V = 2.0 * LIMIT_V / 65536
MOST_HZ = 100_000.0
"""Highest sample rate per channel: the NI-9263's update rate, assumed for inputs too."""
DEFAULT_BUFFER = 1000

Kind = Literal["ai", "ao"]
Samples = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


class WiredRig(Protocol):
    """Interface of a rig as seen from the device's terminals."""

    def measure_um(self) -> float:
        """Return the present position that the sensor measures, in µm."""
        ...

    def put_out(self, voltage_V: float, /) -> None:
        """Apply a voltage to the amplifier's input."""
        ...

    def put_out_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:
        """Begin to output one voltage every 1/rate s."""
        ...

    def extend_wave(self, voltages_V: Sequence[float]) -> None:
        """Extend the playing waveform; raises ValueError if it has ended."""
        ...

    def go_on(self) -> None:
        """End a tick in lockstep without a write."""
        ...

    @property
    def wave_over(self) -> bool:
        """Return whether the waveform has reached its last voltage."""
        ...

    def begin_capture(self, rate_hz: float) -> None:
        """Store position and drive at each 1/rate from here on."""
        ...

    def drain(self) -> tuple[list[float], list[float]]:
        """Return positions in µm and drives in V since the last call."""
        ...

    def end_capture(self) -> None:
        """End the capture."""
        ...


class DaqError(Exception):
    """Error of the device: a status of NI-DAQmx and its text."""

    def __init__(self, code: DAQmxErrors, text: str) -> None:
        super().__init__(text)
        self.code = int(code)


@dataclass(frozen=True, slots=True)
class Terminals:
    """Connections of the physical channels."""

    um_per_V: float = 1.0
    """Scale of the sensor's monitor output, in µm/V."""
    offset_um: float = 0.0
    position: str = ""
    drives: tuple[str, ...] = ()
    """Inputs that measure the amplifier's input."""
    output: str = ""

    def check(self, kind: Kind, channel: str) -> None:
        """Raise an error for a channel that is not connected."""
        known = {"ai": (self.position, *self.drives), "ao": (self.output,)}
        device = channel.partition("/")[0]
        if device not in {name.partition("/")[0] for names in known.values() for name in names}:
            raise DaqError(
                DAQmxErrors.INVALID_DEVICE_ID,
                f"Device identifier is invalid.\n\nDevice Specified: {device}",
            )
        if not channel or channel not in known[kind]:
            raise DaqError(
                DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST,
                "Physical channel specified does not exist on this device."
                f"\n\nPhysical Channel Name: {channel}",
            )


def converted_V(voltages_V: Samples) -> Samples:
    """Return voltages as converted by the device: quantised, and limited to its range."""
    return np.clip(np.rint(voltages_V / STEP_V) * STEP_V, -LIMIT_V, LIMIT_V)


@dataclass(slots=True)
class Task:
    """One task, with inputs or with one output."""

    name: str
    kind: Kind | None = None
    channels: list[str] = field(default_factory=list[str])
    rate_hz: float = 0.0
    """Rate of the sample clock, in Hz; 0: on demand."""
    continuous: bool = False
    count: int = DEFAULT_BUFFER
    buffer_size: int = 0
    """Requested buffer size, in samples; 0: determined by the first write, or by ``count``."""
    started: bool = False
    regenerates: bool = True
    """True if an output may repeat samples; otherwise samples may be added while it plays."""
    written: int = 0
    """Number of samples of a waveform written so far."""
    waiting_V: list[float] = field(default_factory=list[float])
    """Samples that the output has not begun to play, in V."""
    pending_V: Samples = field(default_factory=lambda: np.zeros((0, 0)))
    overwritten: bool = False

    def reserved(self) -> tuple[str, Kind] | None:
        """Return the resource that no other task may use while this one runs."""
        if not self.started or self.kind is None:
            return None
        return self.channels[0].partition("/")[0], self.kind

    def add(self, kind: Kind, channel: str, least_V: float, most_V: float) -> None:
        """Add a channel."""
        if not -LIMIT_V <= least_V < most_V <= LIMIT_V:
            raise DaqError(
                DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
                "Requested value is not a supported value for this property.\n\nRequested range: "
                f"{least_V} V to {most_V} V, supported: -10 V to 10 V",
            )
        if self.kind not in (None, kind) or channel in self.channels:
            raise DaqError(
                DAQmxErrors.CHAN_ALREADY_IN_TASK,
                f"Specified channel cannot be added to the task.\n\nChannel Name: {channel}",
            )
        self.kind = kind
        self.channels.append(channel)

    def clock(self, rate_hz: float, mode: int, count: int) -> None:
        """Set the sample clock."""
        self.must_have_channels()
        if not 0.0 < rate_hz <= MOST_HZ or count < 2:
            raise DaqError(
                DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
                "Requested value is not a supported value for this property.\n\nSample clock: "
                f"{rate_hz} Hz, {count} samples; supported: {MOST_HZ} Hz, 2 samples or more",
            )
        self.rate_hz, self.count = rate_hz, count
        self.continuous = mode == AcquisitionType.CONTINUOUS.value

    def must_have_channels(self) -> None:
        """Raise an error if the task has no channel."""
        if self.kind is None:
            raise DaqError(
                DAQmxErrors.CAN_NOT_PERFORM_OP_WHEN_NO_CHANS_IN_TASK,
                "Specified operation cannot be performed when there are no channels in the task.",
            )

    def keep(self, samples_V: Samples) -> None:
        """Add acquired samples, shape (channels, samples), to the buffer."""
        self.pending_V = np.concatenate([self.pending_V, samples_V], axis=1)
        if self.pending_V.shape[1] > (self.buffer_size or self.count):
            self.overwritten = True

    def take(self, count: int) -> Samples:
        """Remove and return the oldest samples of the buffer, shape (channels, count)."""
        if self.overwritten:
            raise DaqError(
                DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE,
                "The application is not able to keep up with the hardware acquisition.\n\n"
                f"Buffer size: {self.buffer_size or self.count} samples per channel",
            )
        taken, self.pending_V = self.pending_V[:, :count], self.pending_V[:, count:]
        return taken

    def load(self, voltages_V: list[float]) -> None:
        """Write samples to the output's buffer."""
        if self.written and not self.buffer_size:
            raise DaqError(
                DAQmxErrors.WRITE_FAILS_BUFFER_SIZE_AUTO_CONFIGURED,
                "Write failed, because the buffer size was set by the first write.",
            )
        if self.buffer_size and self.written + len(voltages_V) > self.buffer_size:
            raise DaqError(
                DAQmxErrors.SAMPLES_CAN_NOT_YET_BE_WRITTEN,
                "Some or all of the samples to write could not be written to the buffer yet."
                f"\n\nBuffer size: {self.buffer_size} samples",
            )
        self.written += len(voltages_V)
        self.waiting_V += voltages_V

    def begun_V(self) -> list[float]:
        """Remove and return the waiting samples, with which the output starts."""
        if not self.written or (self.regenerates and self.written < self.count):
            raise DaqError(
                DAQmxErrors.OUTPUT_BUFFER_EMPTY,
                "The generation cannot be started, because the buffer holds too few samples."
                f"\n\nSamples: {self.written} of {self.count}",
            )
        begun_V, self.waiting_V = self.waiting_V, []
        return begun_V

    @property
    def wanting(self) -> bool:
        """Return whether samples of the waveform are still missing."""
        return self.written < self.count
