"""Takes events of the journal to their receivers, in order, again until they are taken.

How far a receiver has come is a number in the journal. So nothing is lost over a restart, and at
most the notice that was on its way is sent twice.
"""

import logging
from collections.abc import Callable, Sequence
from time import monotonic

from pincette.engine.threads import RepeatedAction
from pincette_supervisor.journal.store import Store
from pincette_supervisor.notify.senders import (
    Notice,
    NotWantedError,
    RefusedError,
    Sender,
    notice_of,
    topic_of,
)

LOOK_S = 1.0
FIRST_DELAY_S, LONGEST_DELAY_S = 5.0, 300.0
"""Between two tries: doubled with each."""
GIVEN_UP_S = 3 * 86_400.0
"""Time for which a notice is tried before it is left out, in s."""
PAGE = 200
STOP_S = 2.0

log = logging.getLogger("pincette")


class Delivery:
    """State of one receiver: the last delivered notice, and the time of the next attempt."""

    def __init__(
        self, store: Store, sender: Sender, clock: Callable[[], float] = monotonic
    ) -> None:
        self._store, self._sender, self._clock = store, sender, clock
        self._note = f"told {sender.name}"
        self._delay_s = FIRST_DELAY_S
        self._again_at = 0.0
        self._begun = self._ended = False
        self._refused_since: float | None = None
        """Time by the clock of the first refusal of the notice that is tried now."""

    def begin(self) -> None:
        """Begin a receiver that is not known yet with the next event; raises StoreError."""
        _, newest = self._store.event_span()
        known = self._store.get_note(self._note)
        if known is None or int(known) > newest:
            self._store.set_note(self._note, str(newest))
        self._begun = True

    def work(self) -> None:
        """Send what waits, until the receiver refuses one; raises StoreError."""
        if not self._begun:
            self.begin()
        if self._ended or self._clock() < self._again_at:
            return
        number = int(self._store.get_note(self._note) or 0)
        while events := self._store.events_after(number, limit=PAGE):
            for event in events:
                assert event.number is not None
                if topic_of(event) in self._sender.events:
                    job = None if event.job is None else self._store.get(event.job)
                    notice = notice_of(event, job)
                    if notice is not None and not self._sent(notice):
                        return
                    self._store.set_note(self._note, str(event.number))
                number = event.number
            self._store.set_note(self._note, str(number))

    def _sent(self, notice: Notice) -> bool:
        """Send one; true where it is done with."""
        try:
            self._sender.send(notice)
        except NotWantedError as error:
            log.warning("%s accepts no more notices: %s", self._sender.name, error)
            self._ended = True
            return False
        except RefusedError as error:
            # By the monotonic clock, since a step of the time of day must lose no notice.
            if self._refused_since is None:
                self._refused_since = self._clock()
            if self._clock() - self._refused_since > GIVEN_UP_S:
                log.error("%s: given up after days of refusals: %s", self._sender.name, error)
                self._refused_since = None
                return True
            log.warning("%s: %s; again in %g s", self._sender.name, error, self._delay_s)
            self._again_at = self._clock() + self._delay_s
            self._delay_s = min(2.0 * self._delay_s, LONGEST_DELAY_S)
            return False
        self._delay_s = FIRST_DELAY_S
        self._refused_since = None
        return True


class Outbox:
    """A thread for each receiver, so that none waits for another one."""

    def __init__(self, store: Store, senders: Sequence[Sender]) -> None:
        self._threads: list[RepeatedAction] = []
        for sender in senders:
            delivery = Delivery(store, sender)
            # A daemon: a receiver that does not answer delays no end of the program.
            thread = RepeatedAction(f"notices to {sender.name}", LOOK_S, delivery.work)
            thread.run(delivery.begin)
            thread.start()
            self._threads.append(thread)

    def close(self) -> None:
        """End; what waits is sent after the next start."""
        for thread in self._threads:
            thread.close(STOP_S)
