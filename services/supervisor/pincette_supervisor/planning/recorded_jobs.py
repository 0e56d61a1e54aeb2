"""Recorded jobs whose motion can be replayed, from the journal and their records."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pincette.api.job_kinds import job_kinds
from pincette.config import RigFile
from pincette.control.planning.recorded_motion import Pressed, RecordedMotion, RecordedSegment
from pincette.core.faults import Phase
from pincette.records import folder, parquet
from pincette.records.columns import Columns
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.store import JobRow, Store
from pincette_supervisor.plugin import FaultyRequestError
from pincette_supervisor.plugin.figures import Series, series

COLUMNS = (
    "seq",
    "segment",
    "segment_tick",
    "phase",
    "paused",
    "voltage_V",
    "x_um",
    "force_mN",
    "zero_age_s",
)
MOST_SAMPLES = 500_000
"""Largest number of samples of a motion that is read; more would need too much memory."""
PRESSED = (Phase.LOAD, Phase.HOLD, Phase.TRACK, Phase.UNLOAD, Phase.STOPPED)
"""Phases in which a part is pressed."""
MOST_PRESSED = 400
"""Largest number of pressed samples that are kept for a job."""


def recorded_motion(store: Store, records: Path, rig: RigFile, job: str) -> RecordedMotion:
    """Read the motion of a job; with an empty name, that of the newest job with a part.

    Raises
    ------
    FaultyRequestError
        If there is no such job, or its record contains no usable motion.
    """
    if rig.second is not None:
        raise FaultyRequestError(
            "/of_job", "only motions of rigs with 1 driven arm can be replayed, but this rig has 2"
        )
    row = _row(store, rig.rig.name, job)
    path = records / row.id / folder.SAMPLES
    try:
        source = parquet.opened(path)
        if source.metadata.num_rows > MOST_SAMPLES:
            raise FaultyRequestError(
                "/of_job",
                f"job {row.id} has {source.metadata.num_rows} samples, limit {MOST_SAMPLES}: "
                "name a job with a shorter hold",
            )
        table: Columns = source.read(columns=list(COLUMNS)).to_pydict()
    except FileNotFoundError as error:
        raise FaultyRequestError(
            "/of_job",
            f"job {row.id} has no recorded samples: its record is not written yet, or was "
            "deleted; try again in some seconds, or name another job",
        ) from error
    except OSError as error:
        raise FaultyRequestError(
            "/of_job", f"the record of job {row.id} cannot be read: {error.strerror or error}"
        ) from error
    values = row.plan.get("values", {})
    digest = values.get("program", "")
    try:
        return motion_of(
            table,
            job=row.id,
            program=digest,
            period_s=rig.rig.period_s,
            compliance_um_per_mN=rig.model.compliance_um_per_mN,
            pressed_from_mN=None if "residual" in values else 2.0 * rig.grip.contact_force_mN,
        )
    except ValueError as error:
        raise FaultyRequestError("/of_job", f"job {row.id}: {error}") from error


def _row(store: Store, rig: str, job: str) -> JobRow:
    kinds = [
        kind.name
        for kind in job_kinds().values()
        if kind.predicted and kind.holds_part and 1 in kind.arms
    ]
    words = " or ".join(kinds)
    if not job:
        filters = (JobFilter(state="succeeded", rig=rig, kind=kind) for kind in kinds)
        newest = [row for one in filters for row in store.newest(1, one)]
        if not newest:
            raise FaultyRequestError("/of_job", f"no {words} has succeeded: run one first")
        return max(newest, key=lambda row: row.number or 0)
    found = store.get(job)
    if found is None or found.rig != rig:
        raise FaultyRequestError("/of_job", f"rig {rig} has no job {job!r}")
    if found.kind not in kinds or found.state != "succeeded":
        raise FaultyRequestError(
            "/of_job",
            f"job {job} is a {found.kind} that has {found.state}: name a {words} that succeeded",
        )
    return found


def motion_of(
    table: Columns,
    *,
    job: str,
    program: str,
    period_s: float,
    compliance_um_per_mN: float,
    pressed_from_mN: float | None = None,
) -> RecordedMotion:
    """Return the motion of a record's columns.

    Parameters
    ----------
    pressed_from_mN
        Force from which a part counts as pressed, in mN; None to leave out pressed samples.

    Raises
    ------
    ValueError
        If the job was paused, or left its program.
    """
    if not program:
        raise ValueError("it was recorded before motions had digests: record it again")
    if any(table["paused"]):
        raise ValueError("it was paused: record it again without a pause")
    numbers, ticks = series(table, "segment"), series(table, "segment_tick")
    known = ~np.isnan(numbers) & ~np.isnan(series(table, "voltage_V"))
    age_s = series(table, "zero_age_s")
    count = int(np.nanmax(numbers[known])) + 1 if known.any() else 0
    voltage_V = series(table, "voltage_V")
    stamped = _stamped(numbers, age_s, period_s)
    segments: list[RecordedSegment] = []
    for number in range(count):
        here = known & (numbers == number) & (ticks >= 1.0)
        if not here.any():
            raise ValueError(f"segment {number} of its motion program was not played")
        played, first = np.unique(ticks[here], return_index=True)
        at = np.arange(1.0, played[-1] + 1.0)
        volts = np.interp(at, played, voltage_V[here][first])
        phase = next(
            name for name, one in zip(table["phase"], numbers, strict=True) if one == number
        )
        segments.append(RecordedSegment(phase, tuple(volts.tolist()), number in stamped))
    if not segments or segments[-1].phase != Phase.RETREAT:
        raise ValueError("its motion program did not run to the end")
    free_um = series(table, "x_um") + compliance_um_per_mN * series(table, "force_mN")
    reach_um = (float(np.nanmin(free_um)), float(np.nanmax(free_um)))
    pressed = () if pressed_from_mN is None else _pressed(table, pressed_from_mN)
    return RecordedMotion(job, program, period_s, tuple(segments), reach_um, pressed)


def _pressed(table: Columns, from_mN: float) -> tuple[Pressed, ...]:
    """Return samples of the pressed part after the last zero, thinned out.

    A sample is caused by the voltage of the previous tick.
    """
    names = ("segment", "segment_tick", "x_um", "force_mN", "zero_age_s")
    segment, tick, x_um, force_mN, age_s = (series(table, name) for name in names)
    presses = np.array([phase in PRESSED for phase in table["phase"]])
    pressed = presses[1:] & (force_mN[1:] > from_mN) & ~np.isnan(x_um[1:])
    pressed &= ~np.isnan(segment[:-1]) & ~np.isnan(tick[:-1]) & ~np.isnan(age_s[1:])
    rows = np.flatnonzero(pressed)
    rows = rows[:: max(1, -(-len(rows) // MOST_PRESSED))]
    return tuple(
        Pressed(int(segment[row]), int(tick[row]), float(x_um[row + 1]), float(force_mN[row + 1]))
        for row in rows
    )


def _stamped(numbers: Series, age_s: Series, period_s: float) -> set[int]:
    """Return segments at whose end the force was zeroed: the next sample then has a zero of age
    0."""
    fresh: Sequence[int] = np.flatnonzero(age_s < 0.5 * period_s).tolist()
    before = [numbers[place - 1] for place in fresh if place]
    return {int(number) for number in before if not np.isnan(number)}
