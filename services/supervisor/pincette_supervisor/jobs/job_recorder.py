"""Record of a job: opened before the arming, closed after the last sample or after a crash."""

import json
import logging
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

from pincette.api.job_kinds import job_kinds
from pincette.api.places import PlannedPlace
from pincette.api.results import JobResult
from pincette.api.states import STATES
from pincette.bus.protocol import Bus, BusError, RefusalError
from pincette.control.quantities import Document
from pincette.core.faults import ActionCode, Mode
from pincette.core.messages import Action, Applied, Finish, Record, Recorded
from pincette.core.topics import ACTION, FINISH, RECORD
from pincette.engine.threads import log_failure
from pincette.records import folder, mcap_reading, parquet
from pincette.records.mcap_file import NAME
from pincette_supervisor.jobs import planner
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.job_queue import CAPACITY
from pincette_supervisor.jobs.lease import ended_text, interruption
from pincette_supervisor.jobs.tracker import Tracker
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.library import LearnedRepository, LearnedRow
from pincette_supervisor.journal.store import JobRow, StoreError, utc_now
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.plugin import Planned, Run, learning_digest
from pincette_supervisor.plugin.result import course
from pincette_supervisor.results import archive
from pincette_supervisor.results.archive import Record as Gathered
from pincette_supervisor.results.archive import Take, gather
from pincette_supervisor.results.camera import CameraPictures
from pincette_supervisor.results.documents import completeness
from pincette_supervisor.results.run_samples import RunSamples, completed
from pincette_supervisor.rigs.observer import MessageBuffer
from pincette_supervisor.rigs.rig_context import RigContext

# The record of a job: opened before the arming, closed after the last sample.

# Errors of the recorder are returned, not raised: a job that has moved must be completed.


log = logging.getLogger(__name__)
FIGURES = (
    "outcome",
    "force_held_mN",
    "force_uncertainty_mN",
    "peak_force_mN",
    "contact_x_um",
    "contact_stiffness_mN_per_um",
    "rmse_force_mN",
    "rmse_position_um",
    "x_um",
    "voltage_V",
    "statement",
    "zero_invalid",
)
"""Values of a result that are included in its event."""
MOTION = ("shape", "frequency_hz", "force_mean_mN", "force_pp_mN")
"""Values of a plan that describe the motion of a program that learns."""
BEGIN_S = 5.0
FINISH_S = 10.0
FINISH_PER_SAMPLE_S = 6e-4
"""Additional time limit for writing the tables, in s for each sample."""
GOES_ON = "a part is held, and is still recorded"


class JobRecorder:
    """Has a job's samples recorded, and stores its result."""

    def __init__(self, context: RigContext, job: LiveJob, planned: Planned, epoch: int) -> None:
        self._context, self._job, self._planned, self._epoch = context, job, planned, epoch
        self._figures: dict[str, Any] = {}
        self._row: JobRow | None = None
        """Journal row as last read: a journal on a server may be unreachable when the job ends."""
        self.camera = CameraPictures(context.rig.supervisor.camera, context.camera)
        self._gathered: Gathered | None = None
        self._writes, self._turn = 0, threading.Lock()
        """Number of the newest requested write, and its lock; there is a second write if a part
        was held beyond the end."""
        self._closed: Future[Recorded | str] | None = None
        """Contents of the record if it was closed before ``write`` was called; else None."""

    @property
    def verified(self) -> bool | None:
        """Return whether the zero after the release verifies the force; None if that is unknown."""
        return self._figures.get("zero_return_verified")

    @property
    def held(self) -> bool:
        """Return whether the result has a force that was held."""
        return self._figures.get("force_held_mN") is not None

    @property
    def run(self) -> Run | None:
        """Return the recorded data, once it is evaluated."""
        return None if self._gathered is None else self._gathered.run

    def begin(self, row: JobRow) -> str:
        """Open a record; return the reason if that fails."""
        self._row = row
        closer, whose = self._context.closer, (self._context.bus, self._job.id, self._epoch)
        trouble = closer.submit(begin_record, *whose, self._about(row)).result()
        if trouble:  # a recorder that did not reply in time may still open it
            closer.submit(finish_record, *whose, None).add_done_callback(log_failure)
        return trouble

    def _about(self, row: JobRow) -> dict[str, str]:
        about = archive.about(self._planned, row, self._epoch)
        return about | {"request": json.dumps(row.request, ensure_ascii=False)}

    def evaluate(self, tracker: Tracker, collection: MessageBuffer) -> str:
        """Store the result of the samples so far; return the result's fault."""
        job, planned = self._job, self._planned
        row = self._current_row()
        if row is None:
            return ""
        # Done here and not in the archivist's thread, which may still be drawing: until the result
        # exists, the rig is not free.
        self._gathered = record = archive.gathered(
            planned.model.rig, row, planned, self._epoch, tracker.samples, collection.dropped
        )
        if (place := record.result.place) is not None:
            told = record.result.model_copy(
                update={"place": self._context.places.with_bias(job.id, place)}
            )
            record = replace(record, evaluation=replace(record.evaluation, result=told))
            self._gathered = record
        job.store(result=record.tree)
        self._context.write_queue.submit(self._context.use.mark_changed)
        self._keep_learned(record)
        self._figures = {name: record.tree[name] for name in FIGURES if name in record.tree}
        if record.result.goal is not None and record.result.goal.met is not None:
            self._figures["goal_met"] = record.result.goal.met
        names = ("zero_return", "second_zero_return")
        found = [getattr(record.result, name, None) for name in names]
        returned = [each for each in found if each is not None]
        if returned:
            verified = all(each.verified for each in returned)
            self._figures["zero_return_verified"] = verified
            self._context.observer.counters.count_zero_return(verified=verified)
        released = getattr(record.result, "release", None)
        if released is not None:
            self._figures["release"] = released.verdict
            if released.verdict == "sticks":
                self._context.zero_doubt.raise_by(job.id)
        return record.fault

    @contextmanager
    def expected(self) -> Generator[None]:
        """Mark the record as being written from now on.

        If the ``with`` block fails, nothing writes the record, so nothing waits for it.
        """
        self._job.recorded.clear()
        try:
            yield
        except BaseException:
            self._job.finish_record()
            raise

    def close(self, tracker: Tracker) -> None:
        """Have the recorder close the record; its documents are written later.

        The recorder regards a record as incomplete that is open for longer than ``silence_s`` after
        its last sample, but a decision on the job may take a day.
        """
        self._closed = self._closing(tracker)

    def _closing(self, tracker: Tracker) -> "Future[Recorded | str]":
        last_seq = tracker.last_seq if tracker.messages else None
        whose = self._context.bus, self._job.id, self._epoch
        return self._context.closer.submit(finish_record, *whose, last_seq)

    def write(self, tracker: Tracker, *, over: bool) -> None:
        """Have the archivist write the record; meanwhile the rig is free.

        If ``over``, no more samples come. A part that is held after a stop is still being recorded:
        its record has the samples so far, and is closed when the part is released.
        """
        if self._gathered is None:
            self._job.finish_record()
            return
        with self._turn:
            self._writes += 1
        closed: Future[Recorded | str]
        with self.expected():
            if over:
                closed = self._closed or self._closing(tracker)
            else:
                whose = self._context.bus, self._job.id, self._epoch
                about = self._about(self._gathered.job)
                closed = self._context.closer.submit(begin_record, *whose, about)
            writing = self._context.archivist.submit(
                self._write, self._gathered, closed, self._writes, over
            )
            writing.add_done_callback(log_failure)

    def _write(
        self, record: Gathered, closed: Future[Recorded | str], number: int, over: bool
    ) -> None:
        try:
            recorded = closed.result() or GOES_ON
            if number == self._writes:  # otherwise a later write follows
                self._write_documents(record, recorded, over=over)
        except Exception as error:  # no thread waits for the result of this function
            log.exception("the record of job %s was not written", self._job.id)
            self._job.append_cause(lacking(error))
        finally:
            with self._turn:
                if number == self._writes:
                    self._job.finish_record()

    def _write_documents(self, record: Gathered, recorded: Recorded | str, *, over: bool) -> None:
        job = self._job
        # Read again, since the documents include annotations that were edited meanwhile.
        row = self._current_row() or record.job
        try:
            folder = self._context.records / job.id
            self.camera.write(folder)
            replace(record, job=row).write(folder, recorded, self._context.draw)
        except Exception as error:  # whatever the error: the job states what is missing
            log.exception("the documents of job %s were not written", job.id)
            job.append_cause(lacking(error))
        state = completeness(recorded)
        # Open until the part is released: a supervisor that starts meanwhile closes it.
        job.store(plan={**row.plan, "record": state | {"open": not over}})
        append = self._context.events.append
        self._context.write_queue.submit(partial(append, "record", job.id, **state))

    def _current_row(self) -> JobRow | None:
        try:
            self._row = self._context.store.get(self._job.id)
        except StoreError as error:
            log.error("%s", error)
        return self._row

    def _keep_learned(self, record: Gathered) -> None:
        """Store what the program has learned for its next job; erase it if it did not help."""
        learned, planned = record.evaluation.learned, self._planned
        context, rig = self._context, planned.armed.rig
        told = getattr(record.result, "learned", None)
        if told is not None and told.after_um is not None and not told.kept:
            forget = LearnedRepository(context.store, rig.rig.name).forget
            context.write_queue.submit(partial(forget, told.program))
        if learned is None or not learned.errors_um:
            return
        row = LearnedRow(
            program=learning_digest(planned.program, rig),
            job=self._job.id,
            learned_at=utc_now(),
            motion={n: planned.values[n] for n in MOTION if n in planned.values},
            values_um=learned.values_um,
            errors_um=learned.errors_um,
            best_um=learned.best_um,
            quiet=learned.quiet,
        )
        keep = LearnedRepository(context.store, rig.rig.name).keep
        context.write_queue.submit(partial(keep, row))

    def discard(self, row: JobRow) -> None:
        """Have the record of a loop that could not be armed closed."""
        self._close(row)

    def _close(self, row: JobRow) -> Recorded | str:
        """Close the record and return the outcome; an incomplete record does not fail the job."""
        whose = self._context.bus, self._job.id, self._epoch
        recorded = self._context.closer.submit(finish_record, *whose, None).result()
        self._job.store(plan={**row.plan, "record": completeness(recorded)})
        return recorded

    def publish_result(self) -> None:
        """Append the event of the result, once the job's state is terminal."""
        if self._figures:
            body = {"state": self._job.status.state, **self._figures}
            append = self._context.events.append
            self._context.write_queue.submit(partial(append, "result", self._job.id, **body))


def lacking(error: Exception) -> str:
    """Return the text to append to a job's cause if its documents could not be written."""
    return f"the record is incomplete: {str(error) or type(error).__name__}"


def begin_record(bus: Bus, job: str, epoch: int, about: Mapping[str, str]) -> str:
    """Open the record of an epoch, or write the tables of the open one; return the error."""
    document = Document(json.dumps(dict(about), ensure_ascii=False))
    try:
        bus.call(RECORD, Record(job, epoch, document), BEGIN_S)
    except BusError as error:
        return str(error)
    return ""


def finish_record(bus: Bus, job: str, epoch: int, last_seq: int | None) -> Recorded | str:
    """Close the record; return its contents, or the error."""
    patience_s = FINISH_S + FINISH_PER_SAMPLE_S * max(0, last_seq or 0)
    try:
        return cast(Recorded, bus.call(FINISH, Finish(job, epoch, last_seq), patience_s))
    except BusError as error:
        return str(error)


# Recovery at the start from the end of an earlier supervisor.

ASK_S = 1.0
RECENT = CAPACITY + 4
"""Number of newest jobs that are searched for open records; waiting jobs are newer and are not
counted.
"""
COMPARED = 10
"""Number of the newest jobs whose records are compared with their manifests at the start."""


@dataclass(frozen=True, slots=True)
class UnfinishedJobs:
    """Jobs whose records an earlier supervisor has left open, and which are being completed."""

    stored: Mapping[str, Future[None]] = field(default_factory=dict[str, Future[None]])

    def being_written(self, job: str) -> bool:
        """Return whether results of the closed record are not stored yet."""
        return job in self.stored and not self.stored[job].done()


NOTHING = UnfinishedJobs()


def stop_left_program(context: RigContext, jobs: Sequence[str]) -> None:
    """Stop a program that an earlier supervisor has left running, and record the stop in its
    job."""
    # The stop is requested once. A held part stays held until a person starts a job that holds or
    # releases it; a free arm comes to rest, and a part that a calibration presses is released. No
    # job is continued.
    row = context.store.get(jobs[-1]) if jobs else None
    how = interruption(None if row is None else job_kinds().get(row.kind))
    stopped = _stop(context, how) or _stopped_by_itself(context)
    if not stopped:
        return
    name = None if row is None else row.id

    def write() -> None:
        with context.events.transaction("rig", name, found="a program played", did=stopped):
            found = None if name is None else context.store.get(name)
            if found is not None:
                context.store.change(found.id, cause=f"{found.cause}; {stopped}")

    try:
        write()
    except StoreError as error:  # for example on a full disk
        log.error("%s", error)
        context.write_queue.post(write)


def complete_left_records(context: RigContext, notify: Callable[[], None]) -> UnfinishedJobs:
    """Complete the records that an earlier supervisor has left open; see ``UnfinishedJobs``.

    ``notify`` is called after each completed record.
    """
    applied = context.observer.newest(Applied)
    stored: dict[str, Future[None]] = {}
    for left in _unwritten(context):
        # Writing its tables takes time, and an emergency stop must be accepted meanwhile.
        epoch = int(left.epoch or 0)
        last_seq = None if applied is None or applied.epoch != epoch else applied.seq
        closed = context.closer.submit(_closed, context.bus, left.id, epoch, last_seq)
        stored[left.id] = context.archivist.submit(_store_end, context, left, closed)
        stored[left.id].add_done_callback(lambda _: notify())
    for row in _recorded(context):
        if row.id not in stored:
            context.archivist.submit(_compare, context, row).add_done_callback(log_failure)
    return UnfinishedJobs(stored)


def _unwritten(context: RigContext) -> list[JobRow]:
    """Return jobs that moved and whose supervisor ended before their record was written, oldest
    first.

    The rig is free while a record is drawn, so there may be several.
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
    """Compare a record with its manifest; have it repaired, and report remaining damage."""
    where = context.records / row.id
    lost = _lost(where, row)
    if not lost:
        return
    log.warning("%s: %s lost or changed since the record was written", where, ", ".join(lost))
    # The recorder repairs its own files before it replies.
    recorded = _closed(context.bus, row.id, int(row.epoch or 0), None)
    state = completeness(recorded)
    why = ""
    if lost := _lost(where, row):
        try:
            if folder.LIVE not in lost and where.is_dir():
                _gathered(context, row).write(where, recorded, context.draw)
                lost = _lost(where, row)
        except Exception as error:  # whatever the error: the job states what is missing
            log.exception("the documents of job %s were not rebuilt", row.id)
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
    part = "a held part is released" if how == ActionCode.RETRACT else "a held part stays held"
    return f"the program that still played was stopped after the restart; {part}"


def _stopped_by_itself(context: RigContext) -> str:
    """Return why the controller stopped if its lease ended while no supervisor was running."""
    controller = context.health.status("controller")
    words = "" if controller is None else ended_text(controller)
    if not words:
        return ""
    context.alarms.raise_alarm("lease", words, severity="alarm", clears="acknowledge")
    return words


def _closed(bus: Bus, job: str, epoch: int, last_seq: int | None) -> Recorded | str:
    """Have the recorder close its open record."""
    recorded = finish_record(bus, job, epoch, last_seq)
    if isinstance(recorded, str):  # it may still write the tables of an unfinished record
        recorded = finish_record(bus, job, epoch, last_seq)
    return recorded


def _store_end(context: RigContext, row: JobRow, closed: Future[Recorded | str]) -> None:
    """Store the result of a record that was closed after the restart, and write its documents."""
    recorded = closed.result()
    row = context.store.get(row.id) or row
    values: dict[str, object] = {}
    try:
        made = None if isinstance(recorded, str) else _gathered(context, row)
        if made is not None:
            made.write(context.records / row.id, recorded, context.draw)
            values = {"result": made.tree}
    except Exception as error:  # whatever the error: the job states what is missing
        log.exception("the record of job %s was not completed", row.id)
        values = {"cause": "; ".join(filter(None, (row.cause, lacking(error))))}
    if row.result is None and "result" not in values:
        found = _result(context.records / row.id / folder.SAMPLES, context.rig.rig.period_s)
        values |= {} if found is None else {"result": found.model_dump(mode="json")}
    context.store.change(row.id, plan={**row.plan, "record": completeness(recorded)}, **values)
    context.use.mark_changed()


def _gathered(context: RigContext, row: JobRow) -> Gathered:
    """Return the recorded job with its result, if it has one.

    Raises OSError, or ValueError if the original plan of the job cannot be computed again.
    """
    path = context.records / row.id / NAME
    request = REQUEST.validate_json(json.dumps({"kind": row.kind, **row.request}))
    known = row.plan["values"].get("place")
    place = None if known is None else PlannedPlace.model_validate(known)
    resolved = planner.resolve(context, request, moving=True, place=place)
    planned = replace(planner.plan(context, resolved), values=row.plan["values"])
    if mcap_reading.read_about(path)["model_digest"] != planned.model.digest:
        raise ValueError("the model with which it was played is no longer in use")
    take = Take(int(row.epoch or 0), mcap_reading.messages_of(path))
    made = gather(planned.model.rig, row, planned, take)
    if row.result is None:
        return made
    restored = type(made.result).model_validate_json(json.dumps(row.result))
    return replace(made, evaluation=replace(made.evaluation, result=restored))


def _result(samples: Path, period_s: float) -> JobResult | None:
    """Return the progress of a job whose own result cannot be computed."""
    taken = RunSamples(period_s)
    try:
        for part in parquet.parts(samples):
            taken.add_rows(part)
    except (OSError, ValueError):  # no record, or one that a full disk has cut off
        return None
    tables = taken.tables()
    result = JobResult(**course(tables.even, period_s=period_s, dropped=0))
    return completed(result, tables, period_s)
