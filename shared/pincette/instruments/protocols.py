"""What a driver must do, and the one error by which it fails."""

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
"""How a port or an instrument failed: the port cannot be opened; it was open and is gone; no answer
came in time; answers come, but after their time; the bytes are no answer; the instrument refuses;
the reading is beyond the range; it is no reading; the instrument's own watchdog has acted; the
driver was used wrongly."""


class InstrumentError(Exception):
    """An instrument or its link failed; the text says which, and why."""

    def __init__(self, text: str, code: ErrorCode = "garbled") -> None:
        super().__init__(text)
        self.code: ErrorCode = code


class Link(Protocol):
    """A line to an instrument: one request, one answer, both without their terminator."""

    def exchange(self, request: bytes) -> bytes:
        """Send a request and return the answer; raises InstrumentError."""
        ...

    def tell(self, line: bytes) -> None:
        """Send a line that has no answer; raises InstrumentError."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...


class PositionSensor(Protocol):
    """A sensor of the tip's position."""

    def read_um(self) -> float:
        """Return the position in µm, as the instrument counts it; raises InstrumentError."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...


class Block(NamedTuple):
    """Samples of a buffered acquisition, one each 1/rate: position, and the drive as measured."""

    x_um: tuple[float, ...]
    drive_V: tuple[float, ...]


@runtime_checkable
class BufferedSensor(PositionSensor, Protocol):
    """A position sensor with a clock of its own that loses no sample while the loop is late."""

    def begin_capture(self, rate_hz: float) -> None:
        """Acquire at ``rate_hz`` from here on; raises InstrumentError where it cannot."""
        ...

    def read_block(self) -> Block:
        """Return what has been acquired since the last block; raises InstrumentError."""
        ...

    def end_capture(self) -> None:
        """Go back to single readings; nothing where none was begun."""
        ...


class VoltageOutput(Protocol):
    """A voltage output that drives the amplifier."""

    def write_V(self, voltage_V: float) -> None:
        """Put out a voltage; returns when the instrument has accepted it.

        Raises
        ------
        InstrumentError
            Where the instrument refused it or did not answer.
        """
        ...

    def read_V(self) -> float:
        """Return the voltage that is put out now; moves nothing, raises InstrumentError."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...


@runtime_checkable
class WaveOutput(VoltageOutput, Protocol):
    """A voltage output that plays a wave from a buffer of its own; ``write_V`` ends it at once."""

    def begin_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:
        """Put out one voltage each 1/rate; the last one stays. Raises InstrumentError."""
        ...

    def look(self) -> None:
        """Raise InstrumentError where the wave has broken off."""
        ...


@runtime_checkable
class PartsOutput(VoltageOutput, Protocol):
    """A voltage output that writes a step in parts by a clock of its own."""

    def write_parts(self, voltages_V: Sequence[float], interval_s: float) -> None:
        """Put out one voltage each ``interval_s``, the first at once; the last one stays.

        Return when the instrument has accepted all of them. A later write ends the parts at once.
        Raises InstrumentError.
        """
        ...


@runtime_checkable
class WatchedOutput(VoltageOutput, Protocol):
    """A voltage output that goes to a safe value by itself where its host has gone silent."""

    def keep_alive(self) -> None:
        """Say that the host lives; raises InstrumentError."""
        ...

    def clear_trip(self) -> None:
        """Take the instrument out of its safe value's hold, where it is; raises InstrumentError."""
        ...


@dataclass(frozen=True, slots=True)
class Timing:
    """What an instrument takes of a control period, from its line's settings alone."""

    exchange_s: float
    """Request and answer on the line."""
    response_s: float = 0.0
    """From the command to the voltage, or from the position to the reading."""
    buffered_hz: float | None = None
    """Highest rate of a buffered acquisition or output; None where there is none."""
    note: str = ""
    """What of it is assumed, in words."""
    lets_go_s: float | None = None
    """An output: earliest time after its host's last word at which it goes to its safe value by
    itself; None where no watchdog of its own is known."""

    @property
    def bandwidth_hz(self) -> float:
        """Highest frequency that can be identified: a quarter of the rate at which it works.

        A first-order response that settles to 5 % in ``response_s`` = 3 τ adds 1/(2π τ).
        """
        rate_hz = self.buffered_hz or (1.0 / self.exchange_s if self.exchange_s > 0.0 else 0.0)
        quarter_hz = 0.25 * rate_hz
        if self.response_s <= 0.0:
            return quarter_hz
        return min(quarter_hz, 3.0 / (2.0 * pi * self.response_s))
