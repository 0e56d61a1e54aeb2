"""Interface of a simulated instrument to the wire: a table of commands, without I/O."""

from typing import Protocol

TERMINATOR = b"\r"


class Instrument(Protocol):
    """One instrument: a line in, a line or None out, both without their terminator."""

    def answer(self, line: bytes) -> bytes | None:
        """Answer one line; None is silence. The terminator separates the lines of an answer."""
        ...

    def idle(self) -> None:
        """Let the instrument check its own clock; called while no line arrives."""
        ...
