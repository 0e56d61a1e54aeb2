"""A job as it is stored and as it lives, put together for REST."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from pincette.api.job_models import Action, Job, JobKind
from pincette.api.states import ActionType, allowed_actions
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.running.job import LiveJob


def job_view(row: JobRow, live: LiveJob | None, position: int | None, records: Path) -> Job:
    """One job.

    Parameters
    ----------
    live
        The job while it lives; None where another one does, or none.
    position
        Its place in the queue, where it waits for its turn.
    records
        The folder of all records.
    """
    if live is not None and live.revision > row.revision:  # which the journal could not take yet
        row = replace(row, state=live.state, cause=live.cause, revision=live.revision)
    busy = live if live is not None and not live.done.is_set() else None
    # Told after the progress that says what for, hence looked at before it.
    waiting = busy is not None and busy.waiting is not None
    values: dict[str, Any] = row.plan.get("values", {})
    record: dict[str, Any] = row.plan.get("record", {})
    actions: list[ActionType] = []
    if busy is not None or position is not None:
        held = busy is not None and busy.held
        actions = allowed_actions(row.state, held=held, waiting=waiting)
    return Job(
        id=row.id,
        kind=cast(JobKind, row.kind),
        rig=row.rig,
        state=row.state,
        revision=row.revision,
        position=position,
        cause=row.cause,
        request=row.request,
        values=values,
        labels=row.request.get("labels", {}),
        by=row.requested_by,
        progress=None if busy is None else busy.progress,
        result=row.result,
        actions=[
            Action(
                type=action.type,
                requested_at=action.requested_at,
                by=action.by,
                applied_at=action.applied_at,
                seq=action.seq,
            )
            for action in row.actions
        ],
        allowed_actions=actions,
        created_at=row.created_at,
        started_at=row.started_at,
        ended_at=row.ended_at,
        record=None if row.epoch is None else str((records / row.id).absolute()),
        record_complete=record.get("complete"),
        record_detail=record.get("detail", ""),
    )
