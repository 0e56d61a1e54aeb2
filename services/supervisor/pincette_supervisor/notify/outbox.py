"""Takes events of the journal to their receivers, in order, again until they are taken.

How far a receiver has come is a number in the journal. So nothing is lost over a restart, and at
most the notice that was on its way is sent twice.
"""

import logging
import threading
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from time import monotonic

from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.notify.notices import Notice, notice_of, topic_of
from pincette_supervisor.notify.senders import NotWantedError, RefusedError, Sender

LOOK_S = 1.0
FIRST_DELAY_S, LONGEST_DELAY_S = 5.0, 300.0
"""Between two tries: doubled with each."""
GIVEN_UP = timedelta(days=3)
"""Older notices that were not taken are left out."""
PAGE = 200
STOP_S = 2.0

log = logging.getLogger("pincette")


class Delivery:
    """One receiver: how far it has come, and when it is tried again."""

    def __init__(
        self, store: Store, sender: Sender, clock: Callable[[], float] = monotonic
    ) -> None:
        self._store, self._sender, self._clock = store, sender, clock
        self._note = f"told {sender.name}"
        self._delay_s = FIRST_DELAY_S
        self._again_at = 0.0
        self._ended = False

    def begin(self) -> None:
        """A receiver that is not known yet is told of what comes from here on."""
        _, newest = self._store.event_span()
        known = self._store.get_note(self._note)
        if known is None or int(known) > newest:
            self._store.set_note(self._note, str(newest))

    def work(self) -> None:
        """Send what waits, until the receiver refuses one."""
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
            log.warning("%s wants no more notices: %s", self._sender.name, error)
            self._ended = True
            return False
        except RefusedError as error:
            if datetime.now(UTC) - datetime.fromisoformat(notice.at) > GIVEN_UP:
                log.error("%s: given up, as not taken for days: %s", self._sender.name, error)
                return True
            log.warning("%s: %s; again in %g s", self._sender.name, error, self._delay_s)
            self._again_at = self._clock() + self._delay_s
            self._delay_s = min(2.0 * self._delay_s, LONGEST_DELAY_S)
            return False
        self._delay_s = FIRST_DELAY_S
        return True


class Outbox:
    """A thread for each receiver, so that none waits for another one."""

    def __init__(self, store: Store, senders: Sequence[Sender]) -> None:
        self._ended = threading.Event()
        self._threads = [
            threading.Thread(target=self._run, args=[Delivery(store, one)], name=one.name[:40])
            for one in senders
        ]
        for thread in self._threads:
            thread.daemon = True  # a receiver that does not answer keeps nobody
            thread.start()

    def _run(self, delivery: Delivery) -> None:
        begun = False
        while not self._ended.is_set():
            try:
                if not begun:
                    delivery.begin()
                    begun = True
                delivery.work()
            except StoreError as error:
                log.error("notices wait: %s", error)
            self._ended.wait(LOOK_S)

    def close(self) -> None:
        """End; what waits is sent after the next start."""
        self._ended.set()
        for thread in self._threads:
            thread.join(STOP_S)
