"""Line that several drivers share: two channels of a module, or several modules."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial

from pincette.instruments.line.matching import Matching
from pincette.instruments.protocols import InstrumentError, Link

Prepare = Callable[[Link], None]
OpenLine = Callable[[Prepare, Callable[[], Matching]], Link]
"""Function that opens a line.

Its first argument prepares the instruments after the line was lost; the second returns the rules
for the replies of the present driver.
"""


class SharedLine:
    """Line that stays open until the last of its drivers has closed it; used by one thread."""

    def __init__(self, open_line: OpenLine, gone: Callable[[], object]) -> None:
        """Open the line; ``gone`` is called when the last of its drivers has closed it."""
        self._ends: list[LineEnd] = []
        self._gone = gone
        self._matching = Matching()
        self._link = open_line(self._prepare, lambda: self._matching)

    def end(self, on_open: Prepare, matching: Matching) -> "LineEnd":
        """Return an end of the line for one driver."""
        end = LineEnd(self, on_open, matching)
        self._ends.append(end)
        return end

    def of(self, end: "LineEnd") -> Link:
        """Return the line, set to recognise the replies of one driver."""
        self._matching = end.matching
        return self._link

    def leave(self, end: "LineEnd") -> None:
        """Close one end; the last one closes the line."""
        if end in self._ends:
            self._ends.remove(end)
            if not self._ends:
                self._gone()
                self._link.close()

    def _prepare(self, link: Link) -> None:
        speaking = self._matching
        for end in self._ends:
            self._matching = end.matching
            end.on_open(link)
        self._matching = speaking


class LineEnd:
    """A driver's end of a shared line."""

    def __init__(self, line: SharedLine, on_open: Prepare, matching: Matching) -> None:
        self.on_open = on_open
        self.matching = matching
        self._line = line
        self._closed = False

    def exchange(self, request: bytes) -> bytes:
        """Send a request and return the answer; raises InstrumentError."""
        return self._opened().exchange(request)

    def tell(self, line: bytes) -> None:
        """Send a line that has no answer; raises InstrumentError."""
        self._opened().tell(line)

    def close(self) -> None:
        """Close this end; repeated calls do nothing."""
        self._closed = True
        self._line.leave(self)

    def _opened(self) -> Link:
        if self._closed:
            raise InstrumentError("this end of the line is closed; open it again", "misused")
        return self._line.of(self)


_LINES: ContextVar[dict[str, SharedLine] | None] = ContextVar("lines", default=None)


@contextmanager
def one_line_for_each_url() -> Generator[None]:
    """Make all instruments that are opened at the same url within the block share one line."""
    token = _LINES.set({})
    try:
        yield
    finally:
        _LINES.reset(token)


def end_of_line(url: str, on_open: Prepare, matching: Matching, open_line: OpenLine) -> Link:
    """Open a line, or return another end of the line at the url if lines are shared."""
    lines = _LINES.get()
    if lines is None:
        return open_line(on_open, lambda: matching)
    if url not in lines:
        lines[url] = SharedLine(open_line, partial(lines.pop, url, None))
    return lines[url].end(on_open, matching)
