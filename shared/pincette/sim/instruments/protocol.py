"""Interface of a simulated instrument to the wire: a table of commands, without I/O."""

from typing import Protocol

TERMINATOR = b"\r"


class Instrument(Protocol):
    """An instrument: it receives a line and returns a line or None, both without terminator."""

    def answer(self, line: bytes) -> bytes | None:
        """Return the answer to one line; None for no answer.

        An answer of several lines contains the terminator between them.
        """
        ...

    def idle(self) -> None:
        """Let the instrument check its own clock; called while no line arrives."""
        ...
