"""What a person says of a job, also after its end, and whether its record stays."""

from functools import partial
from pathlib import Path

from pincette.api.jobs import Job, JobEdit
from pincette.records import folder
from pincette_supervisor import problems
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.jobs.refusals import require_job
from pincette_supervisor.journal.store import JobRow, utc_now
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.results.documents import restate


def edit(manager: JobManager, name: str, said: JobEdit, by: str) -> Job:
    """Keep what is said of a job, in the journal and in the documents of its record."""
    context = manager.context
    values = said.model_dump(exclude_none=True)
    require_job(context.store, name)
    if values:
        with context.events.transaction("edit", name, changed=sorted(values), by=by):
            revision = context.store.change(name, **values)
        manager.index.note_revision(name, revision)
        row = require_job(context.store, name)
        try:
            context.archivist.submit(partial(_restate, context.records / name, row)).result()
        except OSError as error:
            raise ProblemError(
                503, "store-failed", "The record cannot be written", f"{name}: {error}"
            ) from error
    return manager.index.job(name)


def _restate(where: Path, row: JobRow) -> None:
    if where.is_dir():
        folder.pin(where, pinned=row.pinned)
        restate(where, row)


def delete_record(manager: JobManager, name: str, by: str) -> Job:
    """Delete the files of a job that has ended; the journal keeps the job and its result."""
    context = manager.context
    row = require_job(context.store, name)
    where, active = context.records / name, manager.active
    if active is not None and active.id == name:
        raise _kept(f"job {name} is {active.status.state}: its record is still being written")
    if row.pinned:
        raise _kept(f"the record of job {name} is pinned: unpin it first")
    if not where.is_dir():
        raise problems.not_found("record of job", name)
    record = {"deleted_at": utc_now(), "detail": f"deleted by {by}"}
    try:
        folder.delete(context.records, name)
    except OSError as error:
        raise ProblemError(
            503, "store-failed", "The record cannot be deleted", f"{name}: {error}"
        ) from error
    with context.events.transaction("edit", name, changed=["record"], by=by):
        revision = context.store.change(name, plan={**row.plan, "record": record})
    manager.index.note_revision(name, revision)
    return manager.index.job(name)


def _kept(why: str) -> ProblemError:
    return ProblemError(409, "record-kept", "The record stays", why)
