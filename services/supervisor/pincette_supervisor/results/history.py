"""Curves of a rig over hours, from the records of its jobs, reduced to the resolution of a
screen."""

import threading
from collections import OrderedDict
from collections.abc import Sequence
from datetime import UTC, datetime
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from pincette.api.history import History, HistoryJob
from pincette.records import folder, parquet
from pincette.records.record_times import SAMPLE_0
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.store import JobRow, Store
from pincette_supervisor.plugin.figures import Series

SECOND = ("second_x_um", "second_force_mN", "second_voltage_V")
"""Columns of the second arm, which records of one arm do not have."""
READ = (
    "t_s",
    "x_um",
    "x_r_um",
    "force_mN",
    "force_r_mN",
    "zero_age_s",
    "voltage_V",
    "sliding_um",
    "second_zero_age_s",
    *SECOND,
)
"""Columns that are read; those that a record does not have are left out."""
NAMES = (
    "x_um",
    "x_r_um",
    "force_mN",
    "force_r_mN",
    "voltage_V",
    "sliding_um",
    "x_error_um",
    "force_error_mN",
    *SECOND,
)
GRID_S = 1.0
"""Grid of the time of day to which records are reduced, in s; no interval is shorter."""
LEAST_S = 1e-4
"""Shortest interval when a single job is read, in s."""
JOBS_MOST, KEPT_JOBS = 500, 128
STRETCHES_OF_A_JOB, KEPT_STRETCHES = 20_000, 250_000
"""Largest number of intervals of one reduced record (a longer record gets a wider grid), and of all
records in memory.
"""
LONGEST_JOB_S = 35 * 86400.0
"""Longest assumed duration of a job, in s: jobs that began earlier than this before the requested
interval are not searched.
"""
Reduced = tuple[Series, Series, Series]
"""Middle of each interval, and rows of smallest and largest values by ``NAMES``."""
NOTHING: Reduced = (np.empty(0), np.empty((len(NAMES), 0)), np.empty((len(NAMES), 0)))


class HistoryReader:
    """Reads records of one rig; data of ended jobs is kept in memory."""

    def __init__(self, rig: str, records: Path, *, lockstep: bool) -> None:
        self.rig, self.records, self.lockstep = rig, records, lockstep
        self._kept: OrderedDict[str, Reduced] = OrderedDict()
        self._lock = threading.Lock()

    def read(self, store: Store, from_s: float, to_s: float, points: int) -> History:
        """Return the curves from one time to another, in at most ``points`` intervals."""
        rows, left_out = _jobs(store, self.rig, from_s, to_s)
        step_s = max(GRID_S, ceil((to_s - from_s) / points / GRID_S) * GRID_S)
        found: list[Reduced] = []
        jobs: list[HistoryJob] = []
        with self._lock:  # one reader at a time: a screen can wait, the supervisor cannot
            for row in rows:
                reduced = self._of(row)
                if reduced is not None:
                    found.append(reduced)
                jobs.append(_view(row, recorded=reduced is not None))
        at_s, low, high = joined(found, from_s, to_s, step_s)
        return History(
            rig=self.rig,
            from_s=from_s,
            to_s=to_s,
            step_s=step_s,
            at_s=[float(value) for value in at_s],
            low=_columns(low),
            high=_columns(high),
            jobs=jobs,
            left_out=left_out,
        )

    def read_job(self, row: JobRow, points: int) -> History:
        """Return the curves of one job over its own time, in about ``points`` intervals."""
        from_s = seconds(row.started_at or row.created_at)
        try:
            with self._lock:
                found = _read(self.records / row.id / folder.SAMPLES, 0.0, None, points)
        except (OSError, ValueError):  # see ``_of``
            found = None
        at_s, low, high = found or NOTHING
        spent_s = float(at_s[-1]) if at_s.size else 0.0
        return History(
            rig=self.rig,
            from_s=from_s,
            to_s=from_s + spent_s,
            step_s=spent_s / points,
            at_s=[from_s + float(value) for value in at_s],
            low=_columns(low),
            high=_columns(high),
            jobs=[_view(row, recorded=found is not None)],
            left_out=0,
        )

    def _of(self, row: JobRow) -> Reduced | None:
        if row.started_at is None or row.ended_at is None:
            return None
        if row.id in self._kept:
            self._kept.move_to_end(row.id)
            return self._kept[row.id]
        try:
            path = self.records / row.id / folder.SAMPLES
            if self.lockstep:
                begun_s = seconds(row.started_at)
                reduced = _read(path, begun_s, seconds(row.ended_at) - begun_s)
            else:
                sample_0_at = folder.times(path.parent).get(SAMPLE_0, row.started_at)
                reduced = _read(path, seconds(sample_0_at), None)
        except (OSError, ValueError):  # deleted, not written yet, or unusable
            return None
        self._kept[row.id] = reduced
        while len(self._kept) > KEPT_JOBS or (
            len(self._kept) > 1 and sum(one[0].size for one in self._kept.values()) > KEPT_STRETCHES
        ):
            self._kept.popitem(last=False)
        return reduced


def _read(path: Path, begun_s: float, spent_s: float | None, points: int | None = None) -> Reduced:
    """Read a record part by part, and reduce it to the grid, or to ``points`` intervals.

    Raises the errors of ``parquet.parts``.
    """
    ends = [part["t_s"][-1] for part in parquet.parts(path, ["t_s"]) if part["t_s"]]
    if not ends:
        return NOTHING
    grid_s = max(GRID_S, ceil(ends[-1] / STRETCHES_OF_A_JOB / GRID_S) * GRID_S)
    if points is not None:
        grid_s = max(ends[-1] / points, LEAST_S)
    found: list[Reduced] = []
    for part in parquet.parts(path, READ):
        columns = {
            name: np.array([np.nan if v is None else v for v in values], dtype=np.float64)
            for name, values in part.items()
        }
        found.append(reduce(columns, begun_s, spent_s, last_s=ends[-1], grid_s=grid_s))
    return joined(found, -np.inf, np.inf, grid_s)


def seconds(at: str) -> float:
    """Return a time of the journal as seconds since 1970."""
    return datetime.fromisoformat(at).timestamp()


def text_of(at_s: float) -> str:
    """Return a time in seconds since 1970 in the journal's format."""
    stamp = datetime.fromtimestamp(at_s, UTC)
    return stamp.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _jobs(store: Store, rig: str, from_s: float, to_s: float) -> tuple[list[JobRow], int]:
    """Return the jobs that ran in a period, oldest first, and the number of omitted ones."""
    wanted = JobFilter(
        rig=rig, created_from=text_of(from_s - LONGEST_JOB_S), created_to=text_of(to_s)
    )
    rows = [
        row
        for row in store.newest(4 * JOBS_MOST, wanted)
        if row.started_at is not None and (row.ended_at is None or seconds(row.ended_at) >= from_s)
    ]
    return rows[:JOBS_MOST][::-1], max(0, len(rows) - JOBS_MOST)


def _view(row: JobRow, *, recorded: bool) -> HistoryJob:
    return HistoryJob(
        id=row.id,
        kind=row.kind,
        state=row.state,
        from_s=seconds(row.started_at or row.created_at),
        to_s=None if row.ended_at is None else seconds(row.ended_at),
        recorded=recorded,
    )


def reduce(
    columns: dict[str, Series],
    begun_s: float,
    spent_s: float | None,
    *,
    last_s: float | None = None,
    grid_s: float = GRID_S,
) -> Reduced:
    """Return smallest and largest values in each interval of a record, or of a part of it.

    ``spent_s`` is the duration of a job whose sample times are not those of the clock: the times of
    the samples are scaled to it. ``last_s`` is then the time of the record's last sample, by
    default of the last sample in ``columns``.
    """
    t_s = columns["t_s"]
    if not t_s.size:
        return NOTHING
    rate = 1.0
    end_s = float(t_s[-1]) if last_s is None else last_s
    if spent_s is not None and end_s > 0.0:
        rate = max(0.0, spent_s) / end_s
    unknown = np.full(t_s.size, np.nan)
    # Before the first zero an estimate has no reference.
    force = np.where(np.isnan(columns["zero_age_s"]), np.nan, columns["force_mN"])
    second_zero_age_s = columns.get("second_zero_age_s", unknown)
    second_force = columns.get("second_force_mN", unknown)
    rows = np.vstack(
        [
            columns["x_um"],
            columns["x_r_um"],
            force,
            columns["force_r_mN"],
            columns["voltage_V"],
            columns["sliding_um"],
            columns["x_um"] - columns["x_r_um"],
            force - columns["force_r_mN"],
            columns.get("second_x_um", unknown),
            np.where(np.isnan(second_zero_age_s), np.nan, second_force),
            columns.get("second_voltage_V", unknown),
        ]
    )
    return _grouped(begun_s + rate * t_s, rows, rows, grid_s)


def _grouped(at_s: Series, low: Series, high: Series, step_s: float) -> Reduced:
    """Group samples into intervals of the clock; their times must be ascending."""
    stretch = np.floor(at_s / step_s)
    first = np.flatnonzero(np.diff(stretch, prepend=-np.inf))
    middle: Series = (stretch[first] + 0.5) * step_s
    return middle, np.fmin.reduceat(low, first, axis=1), np.fmax.reduceat(high, first, axis=1)


def joined(found: Sequence[Reduced], from_s: float, to_s: float, step_s: float) -> Reduced:
    """Return several records as one, within the requested period."""
    if not found:
        return NOTHING
    at_s = np.concatenate([each[0] for each in found])
    low = np.concatenate([each[1] for each in found], axis=1)
    high = np.concatenate([each[2] for each in found], axis=1)
    order = np.argsort(at_s, kind="stable")
    # The second that has begun is included: its middle may be in the future.
    apart_s = GRID_S / 2.0
    order = order[(at_s[order] > from_s - apart_s) & (at_s[order] < to_s + apart_s)]
    if not order.size:
        return NOTHING
    return _grouped(at_s[order], low[:, order], high[:, order], step_s)


def _columns(rows: Series) -> dict[str, list[float | None]]:
    """Return rows by name; those of a second arm only if they have a value."""
    return {
        name: _column(rows[place])
        for place, name in enumerate(NAMES)
        if name not in SECOND or not np.isnan(rows[place]).all()
    }


def _column(values: Any) -> list[float | None]:
    return [None if np.isnan(value) else round(float(value), 4) for value in values]
