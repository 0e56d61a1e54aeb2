"""Interfaces of drivers, and the error that they raise."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Literal, NamedTuple, Protocol, runtime_checkable

ErrorCode = Literal[
    "cannot_open",
    "hung_up",
    "silent",
    "late",
    "garbled",
    "refused",
    "out_of_range",
    "invalid",
    "tripped",
    "misused",
]
"""Kind of failure of a port or an instrument.

``cannot_open``: the port cannot be opened; ``hung_up``: it was open and is lost; ``silent``: no
answer came in time; ``late``: answers come too late; ``garbled``: the bytes are no answer;
``refused``: the instrument refuses; ``out_of_range``: the reading is beyond the range; ``invalid``:
it is no reading; ``tripped``: the host watchdog has tripped; ``misused``: a call is not possible in
the present state.
"""


class InstrumentError(Exception):
    """Error of an instrument or its link; the text contains its name and the reason."""

    def __init__(self, text: str, code: ErrorCode = "garbled") -> None:
        super().__init__(text)
        self.code: ErrorCode = code


class Link(Protocol):
    """Line to an instrument: one request, one answer, both without their terminator."""

    def exchange(self, request: bytes) -> bytes:
        """Send a request and return the answer; raises InstrumentError."""
        ...

    def tell(self, line: bytes) -> None:
        """Send a line that has no answer; raises InstrumentError."""
        ...

    def close(self) -> None:
        """Close the port."""
        ...


class PositionSensor(Protocol):
    """A sensor of the tip's position."""

    def read_um(self) -> float:
        """Return the position in µm as the instrument measures it; raises InstrumentError."""
        ...

    def close(self) -> None:
        """Close the port."""
        ...


class Block(NamedTuple):
    """Samples of a buffered acquisition at intervals of 1/rate: position and measured drive."""

    x_um: tuple[float, ...]
    drive_V: tuple[float, ...]


@runtime_checkable
class BufferedSensor(PositionSensor, Protocol):
    """Position sensor with its own clock, which loses no sample while the control loop is late."""

    def begin_capture(self, rate_hz: float) -> None:
        """Begin an acquisition at ``rate_hz``; raises InstrumentError if it is not possible."""
        ...

    def read_block(self) -> Block:
        """Return the samples acquired since the last block; raises InstrumentError."""
        ...

    def end_capture(self) -> None:
        """Return to single readings; does nothing if no acquisition was begun."""
        ...


class VoltageOutput(Protocol):
    """Voltage output that drives the amplifier."""

    def write_V(self, voltage_V: float) -> None:
        """Apply a voltage; returns when the instrument has accepted it.

        Raises
        ------
        InstrumentError
            If the instrument refused it or did not answer.
        """
        ...

    def read_V(self) -> float:
        """Return the present output voltage in V; moves nothing, raises InstrumentError."""
        ...

    def close(self) -> None:
        """Close the port."""
        ...


@runtime_checkable
class WaveOutput(VoltageOutput, Protocol):
    """Voltage output that plays a waveform from its own buffer; ``write_V`` ends it at once."""

    def begin_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:
        """Output one voltage every 1/rate, and keep the last one. Raises InstrumentError."""
        ...

    def look(self) -> None:
        """Raise InstrumentError if the waveform has been interrupted."""
        ...


@runtime_checkable
class PartsOutput(VoltageOutput, Protocol):
    """Voltage output that writes a control step in parts, timed by its own clock."""

    def write_parts(self, voltages_V: Sequence[float], interval_s: float) -> None:
        """Output one voltage every ``interval_s``, the first immediately, and keep the last one.

        Return when the instrument has accepted all of them. A later write ends the parts at once.
        Raises InstrumentError.
        """
        ...


@runtime_checkable
class WatchedOutput(VoltageOutput, Protocol):
    """Voltage output that goes to a safe value on its own if its host becomes silent."""

    def keep_alive(self) -> None:
        """Send the heartbeat of the host; raises InstrumentError."""
        ...

    def clear_trip(self) -> None:
        """Make the instrument leave its safe value if its watchdog has tripped.

        Raises InstrumentError.
        """
        ...


@dataclass(frozen=True, slots=True)
class Timing:
    """Time that an instrument needs in a control period, from the settings of its line only."""

    exchange_s: float
    """Duration of request and reply on the line, in s."""
    response_s: float = 0.0
    """Time from the command to the voltage, or from the position to the reading, in s."""
    buffered_hz: float | None = None
    """Highest rate of a buffered acquisition or output, in Hz; None if there is none."""
    note: str = ""
    """Assumptions behind the stated times, as text."""
    lets_go_s: float | None = None
    """Shortest time in s after the last heartbeat at which an output goes to its safe value on its
    own; None if no watchdog is known."""

    @property
    def bandwidth_hz(self) -> float:
        """Return the highest identifiable frequency in Hz: a quarter of the instrument's rate.

        A first-order response, which settles to 5 % in ``response_s`` = 3 τ, limits it to 1/(2π τ).
        """
        rate_hz = self.buffered_hz or (1.0 / self.exchange_s if self.exchange_s > 0.0 else 0.0)
        quarter_hz = 0.25 * rate_hz
        if self.response_s <= 0.0:
            return quarter_hz
        return min(quarter_hz, 3.0 / (2.0 * pi * self.response_s))
