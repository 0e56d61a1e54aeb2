"""The record of a job: opened before the arming, closed after the last sample."""

# Errors of the recorder are returned, not raised: a job that has moved must come to its end.

import json
import logging
import threading
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from typing import Any, cast

from pincette.bus.protocol import Bus, BusError
from pincette.control.quantities import Document
from pincette.core.messages import Finish, Record, Recorded
from pincette.core.topics import FINISH, RECORD
from pincette.engine.threads import log_failure
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.tracker import Tracker
from pincette_supervisor.journal.learned import LearnedRepository, LearnedRow
from pincette_supervisor.journal.store import JobRow, StoreError, utc_now
from pincette_supervisor.kinds.functions import Run
from pincette_supervisor.model.residuals import learning_digest
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.results import archive
from pincette_supervisor.results.archive import Record as Gathered
from pincette_supervisor.results.documents import completeness
from pincette_supervisor.rigs.observer import MessageBuffer
from pincette_supervisor.rigs.rig_context import RigContext

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
)
"""Figures of a result that its event has."""
MOTION = ("shape", "frequency_hz", "force_mean_mN", "force_pp_mN")
"""Values of a plan that say what a program does that has learned."""
BEGIN_S = 5.0
FINISH_S = 10.0
FINISH_PER_SAMPLE_S = 6e-4
"""Writing the tables takes longer with more samples."""
GOES_ON = "a part is held, and is still recorded"


class JobRecorder:
    """Has a job's samples recorded, and stores its result."""

    def __init__(self, context: RigContext, job: LiveJob, planned: Planned, epoch: int) -> None:
        self._context, self._job, self._planned, self._epoch = context, job, planned, epoch
        self._figures: dict[str, Any] = {}
        self._row: JobRow | None = None
        """As it was last read: a journal on a server may be out of reach at the end."""
        self._gathered: Gathered | None = None
        self._writes, self._turn = 0, threading.Lock()
        """How often it was to be written: once more where a part was held beyond the end."""

    @property
    def run(self) -> Run | None:
        """What was gathered, once it is evaluated."""
        return None if self._gathered is None else self._gathered.run

    def begin(self, row: JobRow) -> str:
        """Have a record begun; returns why there is none."""
        self._row = row
        closer, whose = self._context.closer, (self._context.bus, self._job.id, self._epoch)
        trouble = closer.submit(begin_record, *whose, self._about(row)).result()
        if trouble:  # one that did not answer in time may open it all the same
            closer.submit(finish_record, *whose, None).add_done_callback(log_failure)
        return trouble

    def _about(self, row: JobRow) -> dict[str, str]:
        about = archive.about(self._planned, row, self._epoch)
        return about | {"request": json.dumps(row.request, ensure_ascii=False)}

    def evaluate(self, tracker: Tracker, collection: MessageBuffer) -> str:
        """Store the result of the samples so far; returns the result's fault."""
        job, planned = self._job, self._planned
        row = self._current_row()
        if row is None:
            return ""
        # Not by the archivist, who may still draw: the rig is not free before this is done.
        self._gathered = record = archive.gathered(
            planned.model.rig, row, planned, self._epoch, tracker.samples, collection.dropped
        )
        job.store(result=record.tree)
        self._keep_learned(record)
        self._figures = {name: record.tree[name] for name in FIGURES if name in record.tree}
        if record.result.goal is not None and record.result.goal.met is not None:
            self._figures["goal_met"] = record.result.goal.met
        returned = getattr(record.result, "zero_return", None)
        if returned is not None:
            self._figures["zero_return_verified"] = returned.verified
            self._context.observer.counters.count_zero_return(verified=returned.verified)
        return record.fault

    def write(self, tracker: Tracker, *, over: bool) -> None:
        """Have the record written by the archivist; the rig is free meanwhile.

        ``over``: no more samples come. A part that is held after a stop is still being recorded:
        its record has the samples so far, and is closed when the part is let go.
        """
        if self._gathered is None:
            self._job.finish_record()
            return
        last_seq = tracker.last_seq if tracker.messages else None
        with self._turn:
            self._writes += 1
            self._job.recorded.clear()
        whose = self._context.bus, self._job.id, self._epoch
        closed: Future[Recorded | str]
        if over:
            closed = self._context.closer.submit(finish_record, *whose, last_seq)
        else:
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
            if number == self._writes:  # else the part was let go before anything was drawn
                self._write_documents(record, recorded, over=over)
        except Exception as error:  # nobody asks for what this thread comes to
            log.exception("the record of job %s was not written", self._job.id)
            self._job.append_cause(lacking(error))
        finally:
            with self._turn:
                if number == self._writes:
                    self._job.finish_record()

    def _write_documents(self, record: Gathered, recorded: Recorded | str, *, over: bool) -> None:
        job = self._job
        # What was said of it meanwhile belongs into the documents.
        row = self._current_row() or record.job
        try:
            replace(record, job=row).write(self._context.records / job.id, recorded)
        except Exception as error:  # whatever it was, the job says that they are lacking
            log.exception("the documents of job %s were not written", job.id)
            job.append_cause(lacking(error))
        state = completeness(recorded)
        # Open until the part is let go: a supervisor that is started meanwhile closes it.
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
        """Keep what the program has learned, for its next job."""
        learned, planned = record.evaluation.learned, self._planned
        if learned is None or not learned.errors_um:
            return
        context, rig = self._context, planned.armed.rig
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
        """Have the record closed; an incomplete record never fails the job."""
        whose = self._context.bus, self._job.id, self._epoch
        recorded = self._context.closer.submit(finish_record, *whose, None).result()
        self._job.store(plan={**row.plan, "record": completeness(recorded)})
        return recorded

    def publish_result(self) -> None:
        """Append the event of the result, once the job's state is terminal."""
        if self._figures:
            body = {"state": self._job.state, **self._figures}
            append = self._context.events.append
            self._context.write_queue.submit(partial(append, "result", self._job.id, **body))


def lacking(error: Exception) -> str:
    """What the cause of a job says whose documents could not be written."""
    return f"the record is incomplete: {str(error) or type(error).__name__}"


def begin_record(bus: Bus, job: str, epoch: int, about: Mapping[str, str]) -> str:
    """Open the record of an epoch, or write the tables of the open one; returns the error."""
    document = Document(json.dumps(dict(about), ensure_ascii=False))
    try:
        bus.call(RECORD, Record(job, epoch, document), BEGIN_S)
    except BusError as error:
        return str(error)
    return ""


def finish_record(bus: Bus, job: str, epoch: int, last_seq: int | None) -> Recorded | str:
    """Close the record; returns its contents, or the error."""
    patience_s = FINISH_S + FINISH_PER_SAMPLE_S * max(0, last_seq or 0)
    try:
        return cast(Recorded, bus.call(FINISH, Finish(job, epoch, last_seq), patience_s))
    except BusError as error:
        return str(error)
