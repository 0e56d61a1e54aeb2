"""Recovery at start from an earlier supervisor's end."""

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from pathlib import Path

from pincette.api.job_kinds import job_kinds
from pincette.api.results import JobResult
from pincette.api.states import STATES
from pincette.bus.protocol import Bus, BusError, RefusalError
from pincette.core.faults import ActionCode, Mode
from pincette.core.messages import Action, Applied, Recorded
from pincette.core.topics import ACTION
from pincette.engine.threads import log_failure
from pincette.records import folder, mcap_reading, parquet
from pincette.records.mcap_file import NAME
from pincette_supervisor.jobs import policies
from pincette_supervisor.jobs.job_queue import CAPACITY
from pincette_supervisor.jobs.job_recorder import finish_record, lacking
from pincette_supervisor.jobs.lease import ended_text
from pincette_supervisor.jobs.planner import plan
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.results.archive import Record as Gathered
from pincette_supervisor.results.archive import Take, gather
from pincette_supervisor.results.documents import completeness
from pincette_supervisor.results.long_hold import completed
from pincette_supervisor.results.result import course
from pincette_supervisor.results.run_samples import RunSamples
from pincette_supervisor.rigs.rig_context import RigContext

log = logging.getLogger(__name__)
ASK_S = 1.0
RECENT = CAPACITY + 4
"""Jobs among which those with a record left open are sought: those that wait are newer."""
COMPARED = 10
"""Number of the newest jobs whose records a start compares with their manifests."""


@dataclass(frozen=True, slots=True)
class Left:
    """The jobs whose records an earlier supervisor has left open, and which are made meanwhile."""

    stored: Mapping[str, Future[None]] = field(default_factory=dict[str, Future[None]])

    def being_written(self, job: str) -> bool:
        """Whether what the closed record gives is still to be stored."""
        return job in self.stored and not self.stored[job].done()


NOTHING = Left()


def recover_from_crash(
    context: RigContext, jobs: Sequence[str], notify: Callable[[], None]
) -> Left:
    """Stop a program that still plays, and complete the records that an earlier one has left.

    ``notify`` is called as each is complete.
    """
    # The program is asked once. A held part stays held until a person holds or releases it by a
    # job; a free arm comes to rest, and what a calibration presses is let go. No job is continued.
    row = context.store.get(jobs[-1]) if jobs else None
    how = policies.interruption("" if row is None else row.kind)
    stopped = _stop(context, how) or _stopped_by_itself(context)
    if stopped:
        name = None if row is None else row.id
        with context.events.transaction("rig", name, found="a program played", did=stopped):
            if row is not None:
                context.store.change(row.id, cause=f"{row.cause}; {stopped}")
    applied = context.observer.newest(Applied)
    stored: dict[str, Future[None]] = {}
    for left in _unwritten(context):
        # Making its tables takes its time, and an emergency stop must be taken meanwhile.
        epoch = int(left.epoch or 0)
        last_seq = None if applied is None or applied.epoch != epoch else applied.seq
        closed = context.closer.submit(_closed, context.bus, left.id, epoch, last_seq)
        stored[left.id] = context.archivist.submit(_store_end, context, left, closed)
        stored[left.id].add_done_callback(lambda _: notify())
    for row in _recorded(context):
        if row.id not in stored:
            context.archivist.submit(_compare, context, row).add_done_callback(log_failure)
    return Left(stored)


def _unwritten(context: RigContext) -> list[JobRow]:
    """Jobs that have moved, whose supervisor ended before their record was written; by age.

    The rig is free while a record is drawn, and so there may be several.
    """
    found = context.store.newest(RECENT, JobFilter(rig=context.rig.rig.name))
    return [row for row in reversed(found) if row.epoch is not None and _is_left(row)]


def _recorded(context: RigContext) -> list[JobRow]:
    """Return the newest jobs whose records were written and not deleted."""
    found = context.store.newest(COMPARED, JobFilter(rig=context.rig.rig.name))
    return [
        row
        for row in found
        if row.epoch is not None
        and not _is_left(row)
        and "deleted_at" not in row.plan.get("record", {"deleted_at": ""})
    ]


def _compare(context: RigContext, row: JobRow) -> None:
    """Compare a record with its manifest; have it repaired, and state what stays damaged."""
    where = context.records / row.id
    lost = _lost(where, row)
    if not lost:
        return
    log.warning("%s: %s lost or changed since the record was written", where, ", ".join(lost))
    # The recorder repairs its own files before it answers.
    recorded = _closed(context.bus, row.id, int(row.epoch or 0), None)
    state = completeness(recorded)
    why = ""
    if lost := _lost(where, row):
        try:
            if folder.LIVE not in lost and where.is_dir():
                _gathered(context, row).write(where, recorded)
                lost = _lost(where, row)
        except Exception as error:  # whatever it was, the job says that they are lacking
            log.exception("the documents of job %s were not made again", row.id)
            why = f" ({str(error) or type(error).__name__})"
    if lost:
        words = f"{', '.join(lost)} lost or changed in {where}{why}: copy it from a backup"
        state = {
            "complete": False,
            "detail": "; ".join(filter(None, (str(state["detail"]), words))),
        }
    if row.plan["record"] != state:
        context.store.change(row.id, plan={**row.plan, "record": state})


def _lost(where: Path, row: JobRow) -> list[str]:
    """Return the names of files of a record that are missing, or differ from its manifest."""
    found = folder.damaged(where)
    if found == [folder.MANIFEST]:
        return found
    kind = job_kinds().get(row.kind)
    wanted: list[str] = []
    if row.result is not None and kind is not None:
        wanted = [folder.REQUEST, folder.RESULT, folder.REPORT, kind.plot]
    names = {entry["name"] for entry in folder.listed(where)}
    return [*found, *(name for name in wanted if name not in names)]


def _is_left(row: JobRow) -> bool:
    record = row.plan.get("record")
    return STATES[row.state].terminal and (record is None or bool(record.get("open")))


def _stop(context: RigContext, how: ActionCode) -> str:
    actuator = context.health.status("actuator")
    if actuator is None or actuator.mode != Mode.ARMED:
        return ""
    try:
        context.bus.call(ACTION, Action(how), ASK_S)
    except RefusalError as error:
        return f"the program was not stopped: {error}"
    except BusError as error:
        return f"the program that still plays could not be stopped: {error}"
    part = "a held part is let go" if how == ActionCode.RETRACT else "a held part stays held"
    return f"the program that still played was stopped after the restart; {part}"


def _stopped_by_itself(context: RigContext) -> str:
    """Return why the controller stopped, where its lease ended while no supervisor ran."""
    controller = context.health.status("controller")
    words = "" if controller is None else ended_text(controller)
    if not words:
        return ""
    context.alarms.raise_alarm("lease", words, severity="alarm", clears="acknowledge")
    return words


def _closed(bus: Bus, job: str, epoch: int, last_seq: int | None) -> Recorded | str:
    """Have the recorder close its open record."""
    recorded = finish_record(bus, job, epoch, last_seq)
    if isinstance(recorded, str):  # it may still make the tables of an unfinished record
        recorded = finish_record(bus, job, epoch, last_seq)
    return recorded


def _store_end(context: RigContext, row: JobRow, closed: Future[Recorded | str]) -> None:
    """Store what the record gives that was closed after the restart, and write its documents."""
    recorded = closed.result()
    row = context.store.get(row.id) or row
    values: dict[str, object] = {}
    try:
        made = None if isinstance(recorded, str) else _gathered(context, row)
        if made is not None:
            made.write(context.records / row.id, recorded)
            values = {"result": made.tree}
    except Exception as error:  # whatever it was, the job says that they are lacking
        log.exception("the record of job %s was not completed", row.id)
        values = {"cause": "; ".join(filter(None, (row.cause, lacking(error))))}
    if row.result is None and "result" not in values:
        found = _result(context.records / row.id / folder.SAMPLES, context.rig.rig.period_s)
        values |= {} if found is None else {"result": found.model_dump(mode="json")}
    context.store.change(row.id, plan={**row.plan, "record": completeness(recorded)}, **values)


def _gathered(context: RigContext, row: JobRow) -> Gathered:
    """The job as it is recorded, with the result that was told of it, if any.

    Raises OSError, or ValueError where it cannot be planned again as it was.
    """
    path = context.records / row.id / NAME
    request = REQUEST.validate_json(json.dumps({"kind": row.kind, **row.request}))
    planned = replace(plan(context, request, moving=True), values=row.plan["values"])
    if mcap_reading.read_about(path)["model_digest"] != planned.model.digest:
        raise ValueError("the model with which it was played is no longer in use")
    take = Take(int(row.epoch or 0), mcap_reading.messages_of(path))
    made = gather(planned.model.rig, row, planned, take)
    if row.result is None:
        return made
    told = type(made.result).model_validate_json(json.dumps(row.result))
    return replace(made, evaluation=replace(made.evaluation, result=told))


def _result(samples: Path, period_s: float) -> JobResult | None:
    """How far a job came, where its own figures cannot be worked out."""
    taken = RunSamples(period_s)
    try:
        for part in parquet.parts(samples):
            taken.add_rows(part)
    except (OSError, ValueError):  # no record, or one that a full disk has cut off
        return None
    tables = taken.tables()
    result = JobResult(**course(tables.even, period_s=period_s, dropped=0))
    return completed(result, tables, period_s)
