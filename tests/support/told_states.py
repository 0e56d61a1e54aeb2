"""States of jobs in the events, compared with the state table."""

from collections.abc import Iterable

from pincette.api import events
from pincette.api.states import STATES, Event, JobState, next_state


def states_told(told: Iterable[events.Event]) -> dict[str, JobState]:
    """Return each job's last state, after checking that every transition is one of the table's."""
    states: dict[str, JobState] = {}
    for row in told:
        if row.kind != "state" or row.job is None:
            continue
        state: JobState = row.body["state"]
        event: Event | None = row.body.get("event")
        before = states.get(row.job)
        if before is None:
            assert state in ("queued", "proposed")
        elif event is None:
            assert state in STATES[before].events.values()
        else:
            assert next_state(before, event) == state
        states[row.job] = state
    return states
