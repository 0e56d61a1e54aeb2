"""Event loop whose turns have a bounded number of socket events.

asyncio handles all sockets that are ready before it does anything else. When a client closes 500
connections at once, that is one turn of a tenth of a second; a stop takes about ten turns.
"""

import asyncio
import selectors

EVENTS = 24
"""Socket events of one turn; the others are handled in the next ones."""


class BoundedSelector(selectors.DefaultSelector):
    """Selector that returns at most ``EVENTS`` events, of all ready sockets in rotation."""

    _place = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for events; the sockets that are left out are still ready the next time."""
        ready = super().select(timeout)
        if len(ready) <= EVENTS:
            return ready
        begin = self._place % len(ready)
        self._place = begin + EVENTS
        return (ready[begin:] + ready[:begin])[:EVENTS]


def new_loop() -> asyncio.AbstractEventLoop:
    """Build the event loop of the REST server."""
    return asyncio.SelectorEventLoop(BoundedSelector())
