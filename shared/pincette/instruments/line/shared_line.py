"""One line for several drivers: two channels of a module, or modules at several addresses."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial

from pincette.instruments.protocols import InstrumentError, Link

Prepare = Callable[[Link], None]


class SharedLine:
    """A line that is open until the last of its drivers has closed it; one thread uses it."""

    def __init__(self, open_line: Callable[[Prepare], Link], gone: Callable[[], object]) -> None:
        """``open_line`` opens it, with what prepares the instruments once it was lost."""
        self._ends: list[LineEnd] = []
        self._gone = gone
        self._link = open_line(self._prepare)

    def end(self, on_open: Prepare) -> "LineEnd":
        """A driver's own end of it."""
        end = LineEnd(self, self._link, on_open)
        self._ends.append(end)
        return end

    def leave(self, end: "LineEnd") -> None:
        """Close one end, and with the last one the line."""
        if end in self._ends:
            self._ends.remove(end)
            if not self._ends:
                self._gone()
                self._link.close()

    def _prepare(self, link: Link) -> None:
        for end in self._ends:
            end.on_open(link)


class LineEnd:
    """What one driver holds of a line that it shares."""

    def __init__(self, line: SharedLine, link: Link, on_open: Prepare) -> None:
        self.on_open = on_open
        self._line, self._link = line, link
        self._closed = False

    def exchange(self, request: bytes) -> bytes:
        """Send a request and return the answer; raises InstrumentError."""
        return self._opened().exchange(request)

    def tell(self, line: bytes) -> None:
        """Send a line that has no answer; raises InstrumentError."""
        self._opened().tell(line)

    def close(self) -> None:
        """Give this end back; twice is once."""
        self._closed = True
        self._line.leave(self)

    def _opened(self) -> Link:
        if self._closed:
            raise InstrumentError("this end of the line is closed; open it again", "misused")
        return self._link


_LINES: ContextVar[dict[str, SharedLine] | None] = ContextVar("lines", default=None)


@contextmanager
def one_line_for_each_url() -> Generator[None]:
    """Within it, what is opened at one url is one line, as the first who opens it wants it."""
    token = _LINES.set({})
    try:
        yield
    finally:
        _LINES.reset(token)


def end_of_line(url: str, on_open: Prepare, open_line: Callable[[Prepare], Link]) -> Link:
    """A line of one's own, or where lines are shared an end of that at the url; or its error."""
    lines = _LINES.get()
    if lines is None:
        return open_line(on_open)
    if url not in lines:
        lines[url] = SharedLine(open_line, partial(lines.pop, url, None))
    return lines[url].end(on_open)
