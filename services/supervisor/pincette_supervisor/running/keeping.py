"""The record of a job: begun before it moves, closed after its last sample."""

import json
from functools import partial
from typing import Any

from pincette.messages import Recorded
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.results import archive, calibration_record
from pincette_supervisor.results.archive import Take
from pincette_supervisor.running import recording
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.observer import Collection
from pincette_supervisor.running.site import Site
from pincette_supervisor.running.tracker import Tracker

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
"""Of a result, those that are told as an event."""
GOES_ON = "a part is held, and is still recorded"


class Keeper:
    """Has a job's samples recorded, and keeps what came of them."""

    def __init__(self, site: Site, job: LiveJob, planned: Planned, epoch: int) -> None:
        self._site, self._job, self._planned, self._epoch = site, job, planned, epoch
        self._told: dict[str, Any] = {}

    def begin(self, row: JobRow) -> str:
        """Have a record begun; returns why there is none."""
        about = archive.about(self._planned, row, self._epoch)
        about["request"] = json.dumps(row.request, ensure_ascii=False)
        return recording.begin(self._site.bus, self._job.id, self._epoch, about)

    def keep(self, tracker: Tracker, collection: Collection, *, over: bool) -> str:
        """Keep result and record; returns why the samples do not give what was asked for.

        ``over`` says that no more samples will come. A part that is held after a stop is still
        being recorded; its record has what has come so far, and is closed when it is let go.
        """
        site, job, planned = self._site, self._job, self._planned
        row = site.store.get(job.id)
        if row is None:
            return ""
        last_seq = tracker.last_seq if tracker.messages else recording.NOTHING
        recorded = self._close(row, last_seq) if over else self.begin(row) or GOES_ON
        take = Take(self._epoch, tracker.messages, collection.dropped)
        calibrates = planned.plan.kind == "calibrate"
        gather = calibration_record.gather if calibrates else archive.gather
        record = site.archivist.submit(gather, planned.model.rig, row, planned, take).result()
        job.keep_result(record.tree)
        try:
            site.archivist.submit(record.write, site.records / job.id, recorded).result()
        except OSError as error:
            job.blame(f"the record is incomplete: {error}")
        self._told = {name: record.tree[name] for name in FIGURES if name in record.tree}
        return record.fault

    def give_up(self, row: JobRow) -> None:
        """Have the record of a loop that could not be armed closed."""
        self._close(row, recording.NOTHING)

    def _close(self, row: JobRow, last_seq: int) -> Recorded | str:
        """Have the record closed; what it lacks never fails the job."""
        recorded = recording.finish(self._site.bus, self._job.id, self._epoch, last_seq)
        self._job.keep_plan({**row.plan, "record": recording.completeness(recorded)})
        return recorded

    def tell(self) -> None:
        """Tell what came of the job, once its state says that it has ended."""
        if self._told:
            told = {"state": self._job.state, **self._told}
            self._site.backlog.do(partial(self._site.events.tell, "result", self._job.id, **told))
