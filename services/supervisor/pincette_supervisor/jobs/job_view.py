"""A new job's row in the journal, and a job's form in REST."""

import hashlib
import json
import secrets
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pincette.api.endings import Ending
from pincette.api.jobs import Action, ArtifactState, Job
from pincette.api.requests import JobRequest
from pincette.api.states import ActionType, allowed_actions
from pincette_supervisor.jobs.crash_recovery import NOTHING, Left
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.journal.database import columns
from pincette_supervisor.journal.store import JobRow, utc_now
from pincette_supervisor.planning.planned import Planned

SAID = ("sample", "batch", "operator", "notes", "labels", "pinned")
"""What a person has said of a job."""


def new_row(request: JobRequest, planned: Planned, rig: str, by: str | None) -> JobRow:
    """The journal row of a new job; its name is the time and a random suffix."""
    stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    return JobRow(
        id=f"{stamp}-{secrets.token_hex(3)}",
        kind=request.kind,
        rig=rig,
        state="queued",
        request=request.model_dump(mode="json", exclude_unset=True),
        plan={
            **planned.plan.model_dump(mode="json", exclude={"curves"}),
            "values": planned.values,
        },
        created_at=utc_now(),
        requested_by=by,
        sample=request.sample,
        batch=request.batch,
        operator=request.operator,
        notes=request.notes,
        labels=dict(request.labels),
        priority=request.priority,
    )


def fingerprint_of(request: JobRequest) -> str:
    """A digest that is equal for equal requests."""
    tree = request.model_dump(mode="json", exclude_unset=True)
    text = json.dumps({**tree, "kind": request.kind}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _ending(row: JobRow) -> Ending | None:
    # As JSON, in which a code may be a text.
    return None if row.ending is None else Ending.model_validate_json(json.dumps(row.ending))


def job_view(
    row: JobRow, live: LiveJob | None, position: int | None, records: Path, left: Left = NOTHING
) -> Job:
    """One job, with its live state and its place in the queue where it has one."""
    if live is not None and live.revision > row.revision:  # not written to the journal yet
        ended = live.ending.model_dump(mode="json") if live.terminal and live.ending else None
        more = {"state": live.state, "cause": live.cause, "ending": ended}
        row = replace(row, **more, revision=live.revision)
    busy = live if live is not None and not live.done.is_set() else None
    # Set after the progress that has the instruction, hence read before it.
    waiting = busy is not None and busy.waiting is not None
    values: dict[str, Any] = row.plan.get("values", {})
    record: dict[str, Any] = row.plan.get("record", {})
    deleted = "deleted_at" in record
    actions: list[ActionType] = []
    if busy is not None or position is not None:
        held = busy is not None and busy.held
        actions = allowed_actions(row.state, held=held, waiting=waiting)
    artifacts: ArtifactState = "none"
    if deleted:
        artifacts = "deleted"
    elif left.being_written(row.id) or (live is not None and not live.recorded.is_set()):
        artifacts = "being_written"
    elif record:
        artifacts = "ready"
    elif busy is not None and row.epoch is not None:
        artifacts = "being_written"
    return Job(
        id=row.id,
        kind=row.kind,
        rig=row.rig,
        state=row.state,
        revision=row.revision,
        position=position,
        cause=row.cause,
        ending=_ending(row),
        request=row.request,
        values=values,
        **{name: getattr(row, name) for name in SAID},
        by=row.requested_by,
        progress=None if busy is None else busy.progress,
        result=row.result,
        actions=[
            Action(**columns(action, "requested_by"), by=action.requested_by)
            for action in row.actions
        ],
        allowed_actions=actions,
        created_at=row.created_at,
        started_at=row.started_at,
        ended_at=row.ended_at,
        record=None if row.epoch is None or deleted else str((records / row.id).absolute()),
        artifacts=artifacts,
        record_complete=record.get("complete"),
        record_detail=record.get("detail", ""),
    )
