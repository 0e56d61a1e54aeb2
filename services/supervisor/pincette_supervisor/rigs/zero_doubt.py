"""Whether a person must confirm that nothing touches the arm before its force is zeroed again."""

from pincette.api.requests import JobRequest, ZeroingRequest
from pincette_supervisor.journal.store import Store


class ZeroDoubt:
    """The job of a rig that touched something before its zero, kept in the journal.

    A force that is zeroed while a part presses is hidden for as long as the zero holds. The
    estimator compares each zero with the one before, but has none after its start. So a job that
    met something at rest makes every later one wait for a person's word, over all restarts.
    """

    def __init__(self, store: Store, rig: str) -> None:
        self._store, self._name = store, f"zero_doubted:{rig}"

    def raise_by(self, job: str) -> None:
        """Remember the job that touched something before its zero."""
        self._store.set_note(self._name, job)

    def settle(self) -> None:
        """Forget it: a person has confirmed that nothing touches the arm."""
        if self._store.get_note(self._name):
            self._store.set_note(self._name, "")

    def blocking(self, request: JobRequest) -> str:
        """Return the name of the job that makes a request wait; empty where none does."""
        if not isinstance(request, ZeroingRequest) or request.zero_confirmed:
            return ""
        return self._store.get_note(self._name) or ""
