"""What a driver must do, and the one error by which it fails."""

from typing import Protocol


class InstrumentError(Exception):
    """An instrument or its link failed; the text says which, and why."""


class Link(Protocol):
    """A line to an instrument: one request, one answer, both without their terminator."""

    def exchange(self, request: bytes) -> bytes:
        """Send a request and return the answer; raises InstrumentError."""
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
