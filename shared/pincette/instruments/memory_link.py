"""A link to an instrument in the same process: the same bytes, no port."""

from collections.abc import Callable

from pincette.instruments.protocols import InstrumentError


class MemoryLink:
    """Hands each request to a function and returns what it says; None is silence."""

    def __init__(self, answer: Callable[[bytes], bytes | None]) -> None:
        self._answer = answer
        self._open = True

    def exchange(self, request: bytes) -> bytes:
        """Ask the instrument.

        Raises
        ------
        InstrumentError
            Where it is silent, or the link has been closed.
        """
        if not self._open:
            raise InstrumentError("memory: the port is closed; open it again")
        reply = self._answer(request)
        if reply is None:
            raise InstrumentError(f"memory: no answer to {request[:40]!r}; check the address")
        return reply

    def close(self) -> None:
        """End it; twice is once."""
        self._open = False
