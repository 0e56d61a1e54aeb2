"""Jobs of a rig by name, with their state: queued, live or ended.

Requests that wait for a change poll this index; of the methods that they call, only ``job`` reads
the journal.
"""

import hashlib
import json
import secrets
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic
from typing import Any

from pincette.api.endings import Ending
from pincette.api.jobs import DESCRIPTION, Action, ArtifactState, Job, JobEdit
from pincette.api.requests import JobRequest
from pincette.api.states import ActionType, JobState, allowed_actions
from pincette.records import folder
from pincette_supervisor.jobs import refusals
from pincette_supervisor.jobs.job import ChangeNotifier, LiveJob
from pincette_supervisor.jobs.job_queue import Entry, JobQueue
from pincette_supervisor.jobs.job_recorder import NOTHING, UnfinishedJobs
from pincette_supervisor.jobs.proposals import STATE, Proposals, approval_until
from pincette_supervisor.journal.database import columns
from pincette_supervisor.journal.store import JobRow, utc_now
from pincette_supervisor.plugin import Planned
from pincette_supervisor.problems import ProblemError, not_found
from pincette_supervisor.results.documents import restate
from pincette_supervisor.rigs.rig_context import RigContext

# A new job's row in the journal, and a job's form in REST.


def new_row(
    request: JobRequest,
    planned: Planned,
    rig: str,
    by: str | None,
    trace: str | None = None,
    state: JobState = "queued",
) -> JobRow:
    """Return the journal row of a new job."""
    return JobRow(
        id=new_id(3),
        kind=request.kind,
        rig=rig,
        state=state,
        request=request.model_dump(mode="json", exclude_unset=True),
        plan={
            **planned.plan.model_dump(mode="json", exclude={"curves"}),
            "values": planned.values,
        },
        created_at=utc_now(),
        requested_by=by,
        traceparent=trace,
        sample=request.sample,
        batch=request.batch,
        operator=request.operator,
        notes=request.notes,
        labels=dict(request.labels),
        priority=request.priority,
    )


def new_id(size: int) -> str:
    """Return an id of the present time and ``size`` random bytes."""
    return f"{datetime.now(UTC).strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(size)}"


def fingerprint_of(members: dict[str, Any]) -> str:
    """Return a digest of the members of a request; equal requests have the same digest."""
    return hashlib.sha256(json.dumps(members, sort_keys=True).encode()).hexdigest()


def _ending(row: JobRow) -> Ending | None:
    # Validated from JSON, in which the codes of faults are texts.
    return None if row.ending is None else Ending.model_validate_json(json.dumps(row.ending))


def job_view(
    row: JobRow,
    live: LiveJob | None,
    position: int | None,
    records: Path,
    left: UnfinishedJobs = NOTHING,
) -> Job:
    """Return one job for REST, with its live state, and its position in the queue if it is
    queued.
    """
    # Read before the status: if the record was stored after the row was read, the status has a
    # newer revision.
    recorded = live is None or live.recorded.is_set()
    status = None if live is None else live.status
    if live is not None and status is not None and status.revision > row.revision:
        # The row was read before the newest change was written to the journal.
        ended = status.ending.model_dump(mode="json") if status.terminal and status.ending else None
        more = {**live.stored, "state": status.state, "cause": status.cause, "ending": ended}
        row = replace(row, **more, revision=status.revision)
    if live is not None and len(live.row.actions) > len(row.actions):  # the row lacks newer actions
        row = replace(row, actions=live.row.actions)
    busy = status if live is not None and not live.done.is_set() else None
    values: dict[str, Any] = row.plan.get("values", {})
    record: dict[str, Any] = row.plan.get("record", {})
    deleted = "deleted_at" in record
    waits = busy is not None and row.state == "awaiting_recovery"
    recovery = busy.recovery if busy is not None and waits else None
    actions: list[ActionType] = []
    if busy is not None or position is not None or row.state == STATE:
        held, waiting = (
            busy is not None and busy.held,
            busy is not None and busy.waiting is not None,
        )
        actions = allowed_actions(row.state, held=held, waiting=waiting, recovery=recovery)
    artifacts: ArtifactState = "none"
    if deleted:
        artifacts = "deleted"
    elif left.being_written(row.id) or not recorded:
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
        **{name: getattr(row, name) for name in (*DESCRIPTION, "labels", "pinned")},
        by=row.requested_by,
        traceparent=row.traceparent,
        progress=None if busy is None else busy.progress,
        recovery=recovery,
        approval_until=approval_until(row),
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


WRITTEN_S = 30.0
"""Longest time that a request waits for records that are being written, in s."""


class JobIndex:
    """The jobs of one rig."""

    def __init__(
        self,
        context: RigContext,
        queue: JobQueue,
        proposals: Proposals,
        changes: ChangeNotifier,
    ) -> None:
        self._context, self._queue, self._changes = context, queue, changes
        self._proposals = proposals
        self._lives: tuple[LiveJob, ...] = ()
        """The most recently started job, after those whose records are still being written."""
        self.left = NOTHING
        """Job whose record an earlier supervisor has left open."""

    @property
    def newest(self) -> LiveJob | None:
        """Return the most recently started job."""
        return next(reversed(self._lives), None)

    @property
    def active(self) -> LiveJob | None:
        """Return the job that occupies the rig; a stopped job still does while it holds a part."""
        live = self.newest
        return None if live is None or live.done.is_set() else live

    def started(self, live: LiveJob) -> None:
        """Add a job that starts, and remove the jobs whose records are complete."""
        self._lives = (*(one for one in self._lives if not one.recorded.is_set()), live)

    def job(self, name: str) -> Job:
        """Return one job; raises ProblemError if there is none of this name.

        While the journal does not answer, a job that was started is returned from memory.
        """
        live = self._live(name)
        if live is not None and self._context.write_queue.late:
            return self.view(live.row)
        return self.view(refusals.require_job(self._context.store, name))

    def view(self, row: JobRow) -> Job:
        """Return a job of the journal in its present state."""
        live, place = self._live(row.id), self._queue.position(row.id)
        return job_view(row, live, place, self._context.records, self.left)

    def has_job(self, name: str) -> bool:
        """Return whether a job is waiting to begin or is the most recently started one."""
        return self._entry(name) is not None or self._live(name) is not None

    def is_over(self, name: str) -> bool:
        """Return whether a job has ended, and no release of its part is in progress."""
        waits = self._entry(name) is not None
        if waits or (live := self._live(name)) is None:
            return not waits
        status = live.status
        if status.next_job is not None:  # over only once the following job can be found
            return False
        return live.done.is_set() or (status.terminal and not status.letting_go)

    def is_recorded(self, name: str) -> bool:
        """Return whether a job has ended and its record is written."""
        if not self.is_over(name):  # checked first, since a record is written after the end
            return False
        live = self._live(name)
        written = live is None or live.recorded.is_set()
        return written and not self.left.being_written(name)

    def wait_for_records(self, timeout_s: float) -> None:
        """Wait until the records of ended jobs are written, for at most ``timeout_s`` in total."""
        deadline = monotonic() + timeout_s
        for live in self._lives:
            if live.status.terminal:
                live.recorded.wait(max(0.0, deadline - monotonic()))

    def changed_since(self, name: str, revision: int) -> bool:
        """Return whether a job has changed since a revision."""
        entry = self._entry(name)
        if entry is not None:
            return entry.revision != revision
        live = self._live(name)
        return self.is_finished(name) or (live is not None and live.status.revision != revision)

    def is_finished(self, name: str) -> bool:
        """Return whether a job has ended: it is not queued and not live, and will not change."""
        live = self._live(name)
        return self._entry(name) is None and (live is None or live.done.is_set())

    def is_settled(self, name: str) -> bool:
        """Return whether the REST form of a job depends on its journal row alone."""
        if self._entry(name) is not None or self.left.being_written(name):
            return False
        live = self._live(name)
        return live is None or (live.done.is_set() and live.recorded.is_set())

    def note_revision(self, name: str, revision: int) -> None:
        """Notify those who wait for a change of a job of a new revision in the journal."""
        if (entry := self._entry(name)) is not None:
            entry.revision = max(entry.revision, revision)
        if (live := self._live(name)) is not None:
            live.revise(revision)
        self._changes.notify_all()

    def edit(self, name: str, said: JobEdit, by: str) -> Job:
        """Store a person's annotations of a job, in the journal and in its record's documents."""
        context = self._context
        values = said.model_dump(exclude_none=True)
        refusals.require_job(context.store, name)
        if values:
            with context.events.transaction("edit", name, changed=sorted(values), by=by):
                revision = context.store.change(name, **values)
            self.note_revision(name, revision)
            row = refusals.require_job(context.store, name)
            try:
                context.archivist.submit(_restate, context.records / name, row).result()
            except OSError as error:
                raise ProblemError(
                    503, "store-failed", "The record cannot be written", f"{name}: {error}"
                ) from error
        return self.job(name)

    def delete_record(self, name: str, by: str) -> Job:
        """Delete the files of an ended job; the journal keeps the job and its result."""
        context, active = self._context, self.active
        row = refusals.require_job(context.store, name)
        if active is not None and active.id == name:
            raise _kept(f"job {name} is {active.status.state}: its record is still being written")
        if row.pinned:
            raise _kept(f"the record of job {name} is pinned: unpin it first")
        if not (context.records / name).is_dir():
            raise not_found("record of job", name)
        record = {"deleted_at": utc_now(), "detail": f"deleted by {by}"}
        try:
            folder.delete(context.records, name)
        except OSError as error:
            raise ProblemError(
                503, "store-failed", "The record cannot be deleted", f"{name}: {error}"
            ) from error
        with context.events.transaction("edit", name, changed=["record"], by=by):
            revision = context.store.change(name, plan={**row.plan, "record": record})
        self.note_revision(name, revision)
        return self.job(name)

    def _entry(self, name: str) -> Entry | None:
        """Return a job that has not begun: queued, or proposed."""
        # Proposals first: an approved job enters the queue before it leaves them.
        return self._proposals.entry(name) or self._queue.entry(name)

    def _live(self, name: str) -> LiveJob | None:
        """Return a started job that may not be recorded yet; the waiting jobs are searched
        first."""
        return next((live for live in self._lives if live.id == name), None)


def _restate(where: Path, row: JobRow) -> None:
    if where.is_dir():
        folder.pin(where, pinned=row.pinned)
        restate(where, row)


def _kept(why: str) -> ProblemError:
    return ProblemError(409, "record-kept", "The record stays", why)
