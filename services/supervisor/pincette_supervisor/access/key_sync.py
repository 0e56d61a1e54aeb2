"""Copies keys from the journal into memory, and audit entries from memory into the journal."""

import logging
import threading

from sqlalchemy.exc import SQLAlchemyError

from pincette_supervisor.access.access import Access
from pincette_supervisor.journal.access_rows import AuditRepository, KeyRepository
from pincette_supervisor.journal.store import Store, StoreError

EVERY_S = 0.5
"""Time within which a key that another program added or revoked takes effect."""

log = logging.getLogger("pincette")


class KeySync:
    """Reads changed keys, and writes the audit log and when keys were used, until closed."""

    def __init__(self, store: Store, access: Access) -> None:
        self._keys, self._audit = KeyRepository(store), AuditRepository(store)
        self._authenticator, self._audit_buffer = access.authenticator, access.audit_buffer
        self._ended = threading.Event()
        self._logged = ""
        self._authenticator.refresh(self._keys)
        self._thread = threading.Thread(target=self._run, name="key-sync")
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.wait(EVERY_S):
            self._sync()

    def _sync(self, *, last: bool = False) -> None:
        try:
            self._authenticator.refresh(self._keys)
            self._audit_buffer.flush(self._audit, everything=last)
            self._logged = ""
        except (StoreError, SQLAlchemyError) as error:
            # Keys stay as they were known, and what was done waits: the disk may have room again.
            if str(error) != self._logged:
                self._logged = str(error)
                log.error("keys and audit log: %s", error)

    def close(self) -> None:
        """End; what waits is written."""
        self._ended.set()
        self._thread.join()
        self._sync(last=True)
