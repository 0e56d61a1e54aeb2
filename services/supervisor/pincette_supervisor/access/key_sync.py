"""Reads keys into memory, and writes sessions and audit entries from memory to the journal."""

from datetime import timedelta

from pincette.engine.threads import RepeatedAction
from pincette_supervisor.access.access import Access
from pincette_supervisor.journal.access_rows import AuditRepository
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import utc_text

EVERY_S = 0.5
"""Time within which a key that another program added or revoked takes effect, in s."""
KEYS = "keys"
"""Cause of the alarm that is raised while keys cannot be read, or their use not be written."""
KEY_CLOCK = "key-clock"
"""Cause of the alarm that is raised while the time of day is behind the latest time seen.

To acknowledge it is to agree to the time of day.
"""
HOUR = timedelta(hours=1)
BEHIND = HOUR
"""Time by which the time of day may be behind without an alarm: less than an error of a zone."""


class KeySync:
    """Reads changed keys, and writes the audit log and when keys were used, until closed.

    While it fails, the store names the cause, from which the alarm of every rig is raised. The
    authenticator itself refuses callers once the keys could not be read for too long.
    """

    def __init__(self, store: Store, access: Access) -> None:
        self._store = store
        self._audit = AuditRepository(store)
        self._authenticator, self._audit_buffer = access.authenticator, access.audit_buffer
        self._authenticator.refresh(store)
        self._repeated = RepeatedAction("key-sync", EVERY_S, self._sync, daemon=False)
        self._repeated.start()

    def _sync(self, *, last: bool = False) -> None:
        try:
            self._authenticator.write_sessions()
            self._authenticator.refresh(self._store)
            self._audit_buffer.flush(self._audit, everything=last)
        except Exception as error:
            # What was done waits: the disk may have room again.
            self._store.troubles[KEYS] = f"keys and audit log: {error}"
            raise
        self._store.troubles.pop(KEYS, None)
        time = self._authenticator.time
        if self._authenticator.keys_wanted and time.ahead >= BEHIND:
            self._store.troubles[KEY_CLOCK] = (
                f"the time of day is {time.ahead / HOUR:.0f} h behind {utc_text(time.now())}, the "
                "latest time seen by this supervisor, and the ends of keys are judged by the "
                "latter: set the clock of this machine, or acknowledge this alarm if it is right"
            )
        else:
            self._store.troubles.pop(KEY_CLOCK, None)

    def close(self) -> None:
        """Stop the thread and write the changes that are not stored yet."""
        self._repeated.close()
        self._repeated.run(lambda: self._sync(last=True))
