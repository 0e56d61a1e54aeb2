"""Link to an instrument in the same process: the same bytes without a port."""

from collections.abc import Callable

from pincette.instruments.protocols import InstrumentError


def _every(_line: bytes) -> bool:
    return True


class MemoryLink:
    """Passes each request to a function and returns its answer; None means silence.

    An answer of several lines contains ``terminator`` between them; the first line that ``accept``
    accepts is returned, as over a port. Without a terminator the answer is returned whole.
    """

    def __init__(
        self,
        answer: Callable[[bytes], bytes | None],
        terminator: bytes | None = b"\r",
        accept: Callable[[bytes], bool] = _every,
    ) -> None:
        self._answer = answer
        self._terminator = terminator
        self._accept = accept
        self._closed = False

    def exchange(self, request: bytes) -> bytes:
        """Return the answer of the instrument.

        Raises
        ------
        InstrumentError
            If it is silent, or the link has been closed.
        """
        reply = self._said(request)
        if reply is not None:
            lines = [reply] if self._terminator is None else reply.split(self._terminator)
            for line in lines:
                if self._accept(line):
                    return line
        raise InstrumentError(f"memory: no answer to {request[:40]!r}; check the address", "silent")

    def tell(self, line: bytes) -> None:
        """Send a line to the instrument; raises InstrumentError if the link has been closed."""
        self._said(line)

    def close(self) -> None:
        """Close the link; repeated calls do nothing."""
        self._closed = True

    def _said(self, line: bytes) -> bytes | None:
        if self._closed:
            raise InstrumentError("memory: the port is closed; open it again", "misused")
        return self._answer(line)
