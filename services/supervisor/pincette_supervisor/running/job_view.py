"""A job as it is stored and as it lives, put together for REST."""

from pathlib import Path
from typing import Any, cast

from pincette.api.job_models import Action, Job, JobKind
from pincette.api.states import allowed_actions
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.running.job import LiveJob


def job_view(row: JobRow, live: LiveJob | None, records: Path) -> Job:
    """One job.

    Parameters
    ----------
    live
        The job while it lives; None where another one does, or none.
    records
        The folder of all records.
    """
    busy = live is not None and not live.done.is_set()
    held = live is not None and busy and live.held
    # Told after the progress that says what for, hence looked at before it.
    waiting = live is not None and busy and live.waiting is not None
    values: dict[str, Any] = row.plan.get("values", {})
    return Job(
        id=row.id,
        kind=cast(JobKind, row.kind),
        rig=row.rig,
        state=row.state,
        cause=row.cause,
        request=row.request,
        values=values,
        labels=row.request.get("labels", {}),
        progress=live.progress if live is not None and busy else None,
        result=row.result,
        actions=[
            Action(type=a.type, requested_at=a.requested_at, by=a.by, seq=a.seq)
            for a in row.actions
        ],
        allowed_actions=allowed_actions(row.state, held=held, waiting=waiting) if busy else [],
        created_at=row.created_at,
        started_at=row.started_at,
        ended_at=row.ended_at,
        record=str((records / row.id).absolute()) if row.result is not None else None,
    )
