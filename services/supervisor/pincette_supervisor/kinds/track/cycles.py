"""The cycles of a tracked path: their errors, and what is learned across them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pincette.control.planning.paths import Path
from pincette.control.planning.repetition import (
    Corrections,
    CycleLearner,
    cycle_ticks,
    no_corrections,
)
from pincette.control.record import replace as changed
from pincette.records.columns import Columns
from pincette_supervisor.kinds.functions import Run
from pincette_supervisor.kinds.track import CycleErrors, Learned
from pincette_supervisor.planning.errors import FaultyRequestError
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.results.figures import Mask, Series, series
from pincette_supervisor.results.result import force_error, position_error


def learning(planned: Planned, path: Path, period_s: float) -> Planned:
    """The plan with a program that learns; raises FaultyRequestError where nothing repeats."""
    if path.knots:
        raise FaultyRequestError(
            "/learn", f"learn = true with a {path.shape}: only a sinusoid or a triangle has cycles"
        )
    try:
        ticks = cycle_ticks(path.cycle_s, period_s)
    except ValueError as error:
        raise FaultyRequestError("/frequency_hz", str(error)) from error
    program = changed(planned.program, corrections=no_corrections(ticks))
    return replace(planned, program=program)


def whole_cycle(path: Path, period_s: float) -> int:
    """Ticks of a cycle; 0 where nothing swings, or not in whole ticks."""
    if path.knots:
        return 0
    try:
        return cycle_ticks(path.cycle_s, period_s)
    except ValueError:
        return 0


def learned_of(run: Run, path: Path) -> Corrections | None:
    """What the program has learned, by the samples as the controller met them."""
    begun = run.planned.program.corrections
    if begun is None:
        return None
    table, period_s = run.table, run.period_s
    learner, slack_s = CycleLearner(begun), 0.5 * period_s
    track = next(
        number for number, one in enumerate(run.planned.program.segments) if one.kind == "path"
    )
    before: tuple[int, bool] | None = None
    names = ("segment", "segment_tick", "paused", "limits_active", "x_um", "x_r_um")
    for segment, tick, paused, limits, x_um, x_r_um in zip(
        *(table[name] for name in names), strict=True
    ):
        if tick is None:
            continue
        # References and limits of a sample are those of the tick before it.
        if before is not None and x_um is not None:
            at_s = before[0] * period_s
            if path.full_from_s - slack_s <= at_s < path.full_to_s - slack_s:
                learner = learner.follow(before[0], x_um - x_r_um, limited=before[1])
        before = (tick, bool(paused) or bool(limits)) if segment == track else None
    return learner.corrections


def told_of(learned: Corrections, program: str) -> Learned:
    """What was learned, for people."""
    return Learned(
        program=program,
        cycles=len(learned.errors_um),
        largest_um=max(abs(value) for value in learned.values_um),
        over=learned.over,
        errors_um=list(learned.errors_um),
    )


def cycle_errors(table: Columns, path: Path, period_s: float, full: Mask) -> list[CycleErrors]:
    """R.m.s. errors over each cycle at full amplitude; none between knots."""
    if path.knots:
        return []
    t_s = (series(table, "segment_tick") - 1.0) * period_s - path.full_from_s
    number = np.floor(t_s / path.cycle_s + 1e-6)
    errors = (
        position_error(table),
        force_error(table),
        series(table, "true_force_mN") - series(table, "force_r_mN"),
    )
    return [_cycle(full & (number == cycle), errors) for cycle in range(path.cycles)]


def _cycle(samples: Mask, errors: Sequence[Series]) -> CycleErrors:
    found = [_rms(error[samples]) for error in errors]
    return CycleErrors(position_um=found[0], force_mN=found[1], true_force_mN=found[2])


def _rms(error: Series) -> float | None:
    if not len(error) or np.isnan(error).any():
        return None
    return float(np.sqrt(np.mean(error**2)))
