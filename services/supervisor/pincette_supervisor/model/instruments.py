"""Which instruments a rig has had, by their serial numbers, and since when."""

import json
from collections.abc import Mapping

from pincette_supervisor.journal.store import Store, utc_now

KEPT = 100
"""Changes that are remembered; older ones name nothing that is still in use."""


class Instruments:
    """The serial numbers of a rig file, and those that were in it before; kept beyond a restart."""

    def __init__(self, store: Store, rig: str, present: Mapping[str, str]) -> None:
        self.present = dict(present)
        note = f"instruments: {rig}"
        noted = store.noted(note)
        self._history: list[tuple[str, dict[str, str]]] = (
            [] if noted is None else [(since, had) for since, had in json.loads(noted)]
        )
        if not self._history or self._history[-1][1] != self.present:
            self._history = [*self._history, (utc_now(), self.present)][-KEPT:]
            store.note(note, json.dumps(self._history))

    def at(self, when: str) -> dict[str, str]:
        """Serial numbers at a time, by table of the rig file; what is not known is not there."""
        for since, had in reversed(self._history):
            if since <= when:
                return had
        return {}
