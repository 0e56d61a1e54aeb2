"""A thread between the gate and the journal."""

import logging
import threading
from collections.abc import Generator
from contextlib import contextmanager

from sqlalchemy.exc import SQLAlchemyError

from pincette_supervisor.access.access import Access
from pincette_supervisor.journal.audit import AuditBook
from pincette_supervisor.journal.keys import KeyBook
from pincette_supervisor.journal.store import Store, StoreError

EVERY_S = 0.5
"""Within which a key that was made or revoked by another program is in force, or is not."""

log = logging.getLogger("pincette")


class Keeper:
    """Looks for changed keys, and writes the audit log and when keys were used."""

    def __init__(self, store: Store, access: Access) -> None:
        self._keys, self._audit = KeyBook(store), AuditBook(store)
        self._gate, self._trail = access.gate, access.trail
        self._ended = threading.Event()
        self._said = ""
        self._gate.renew(self._keys)
        self._thread = threading.Thread(target=self._keep, name="keeper")
        self._thread.start()

    def _keep(self) -> None:
        while not self._ended.wait(EVERY_S):
            self._look()

    def _look(self, *, last: bool = False) -> None:
        try:
            self._gate.renew(self._keys)
            self._trail.flush(self._audit, everything=last)
            self._said = ""
        except (StoreError, SQLAlchemyError) as error:
            # Keys stay as they were known, and what was done waits: the disk may have room again.
            if str(error) != self._said:
                self._said = str(error)
                log.error("keys and audit log: %s", error)

    def close(self) -> None:
        """End; what waits is written."""
        self._ended.set()
        self._thread.join()
        self._look(last=True)


@contextmanager
def kept(store: Store, access: Access) -> Generator[None]:
    """Keep the gate and the journal together meanwhile; raises StoreError where it cannot begin."""
    keeper = Keeper(store, access)
    try:
        yield
    finally:
        keeper.close()
