"""The record of a job: opened before the arming, closed after the last sample."""

# Errors of the recorder are returned, not raised: a job that has moved must come to its end.

import json
from collections.abc import Mapping
from functools import partial
from typing import Any, cast

from pincette.bus.protocol import Bus, BusError
from pincette.control.quantities import Document
from pincette.core.messages import Finish, Record, Recorded
from pincette.core.topics import FINISH, RECORD
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.tracker import Tracker
from pincette_supervisor.journal.learned import LearnedRepository, LearnedRow
from pincette_supervisor.journal.store import JobRow, utc_now
from pincette_supervisor.kinds.functions import Run
from pincette_supervisor.model.residuals import learning_digest
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.results import archive
from pincette_supervisor.results.archive import Record as Gathered
from pincette_supervisor.results.archive import Take
from pincette_supervisor.results.documents import completeness
from pincette_supervisor.rigs.observer import MessageBuffer
from pincette_supervisor.rigs.rig_context import RigContext

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
NO_SAMPLE = -2
"""Last sequence number of a loop without samples; the arming has -1."""
GOES_ON = "a part is held, and is still recorded"


class JobRecorder:
    """Has a job's samples recorded, and stores its result."""

    def __init__(self, context: RigContext, job: LiveJob, planned: Planned, epoch: int) -> None:
        self._context, self._job, self._planned, self._epoch = context, job, planned, epoch
        self._figures: dict[str, Any] = {}
        self.run: Run | None = None
        """What was gathered, once it is stored."""

    def begin(self, row: JobRow) -> str:
        """Have a record begun; returns why there is none."""
        about = archive.about(self._planned, row, self._epoch)
        about["request"] = json.dumps(row.request, ensure_ascii=False)
        return begin_record(self._context.bus, self._job.id, self._epoch, about)

    def store(self, tracker: Tracker, collection: MessageBuffer, *, over: bool) -> str:
        """Store result and record; returns the result's fault; ``over``: no more samples come."""
        # A part that is held after a stop is still being recorded: its record has the samples so
        # far, and is closed when the part is let go.
        context, job, planned = self._context, self._job, self._planned
        row = context.store.get(job.id)
        if row is None:
            return ""
        last_seq = tracker.last_seq if tracker.messages else NO_SAMPLE
        recorded = self._close(row, last_seq) if over else self.begin(row) or GOES_ON
        take = Take(self._epoch, tracker.messages, collection.dropped)
        gather = context.archivist.submit(archive.gather, planned.model.rig, row, planned, take)
        record = gather.result()
        self.run = record.run
        job.store(result=record.tree)
        self._keep_learned(record)
        try:
            context.archivist.submit(record.write, context.records / job.id, recorded).result()
        except OSError as error:
            job.note_cause(f"the record is incomplete: {error}")
        self._figures = {name: record.tree[name] for name in FIGURES if name in record.tree}
        if record.result.goal is not None:
            self._figures["goal_met"] = record.result.goal.met
        return record.fault

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
        self._close(row, NO_SAMPLE)

    def _close(self, row: JobRow, last_seq: int) -> Recorded | str:
        """Have the record closed; an incomplete record never fails the job."""
        recorded = finish_record(self._context.bus, self._job.id, self._epoch, last_seq)
        self._job.store(plan={**row.plan, "record": completeness(recorded)})
        return recorded

    def publish_result(self) -> None:
        """Append the event of the result, once the job's state is terminal."""
        if self._figures:
            body = {"state": self._job.state, **self._figures}
            append = self._context.events.append
            self._context.write_queue.submit(partial(append, "result", self._job.id, **body))


def begin_record(bus: Bus, job: str, epoch: int, about: Mapping[str, str]) -> str:
    """Open the record of an epoch, or write the tables of the open one; returns the error."""
    document = Document(json.dumps(dict(about), ensure_ascii=False))
    try:
        bus.call(RECORD, Record(job, epoch, document), BEGIN_S)
    except BusError as error:
        return str(error)
    return ""


def finish_record(bus: Bus, job: str, epoch: int, last_seq: int) -> Recorded | str:
    """Close the record; returns its contents, or the error."""
    patience_s = FINISH_S + FINISH_PER_SAMPLE_S * max(0, last_seq)
    try:
        return cast(Recorded, bus.call(FINISH, Finish(job, epoch, last_seq), patience_s))
    except BusError as error:
        return str(error)
