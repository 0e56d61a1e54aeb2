"""The cycles of a tracked path: their errors, and what is learned across them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pincette.control.planning.paths import Path
from pincette.control.planning.repetition import (
    Corrections,
    CycleLearner,
    HeldOut,
    cycle_ticks,
    held_out,
    no_corrections,
)
from pincette.control.planning.segments import Track
from pincette.control.record import replace as changed
from pincette.records.columns import Columns
from pincette_supervisor.kinds.track import CycleErrors, Learned
from pincette_supervisor.plugin import FaultyRequestError, Planned, Run
from pincette_supervisor.plugin.figures import Mask, Series, force_error, position_error, series

NOISE_IN_ERROR = 1.15
"""Noise of x - x_r over that of a reading: the loop follows some of it."""


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
        number for number, one in enumerate(run.planned.program.segments) if isinstance(one, Track)
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


def judged(run: Run, learned: Corrections, cycles: Sequence[CycleErrors]) -> HeldOut | None:
    """Hold what was learned against the cycles of this job that it was not learned from.

    Without earlier corrections the first cycle is the one to be better than; else it is the first
    cycle of the first job.
    """
    begun = run.planned.program.corrections
    errors_um = [one.position_um for one in cycles if one.position_um is not None]
    if begun is None or not errors_um or not learned.errors_um:
        return None
    led_um = errors_um if begun.errors_um else errors_um[1:]
    noise_um = NOISE_IN_ERROR * run.planned.armed.rig.sensor.noise_um
    ticks = len(learned.values_um)
    return held_out(learned.errors_um[0], led_um, ticks=ticks, noise_um=noise_um)


def kept(learned: Corrections) -> Corrections:
    """Return what the next job begins with: the corrections that led the best cycle.

    The newest ones have not led a cycle yet.
    """
    return changed(learned, values_um=learned.best_um or learned.values_um)


def told_of(learned: Corrections, program: str, held: HeldOut | None) -> Learned:
    """Return what was learned, for people."""
    return Learned(
        program=program,
        cycles=len(learned.errors_um),
        largest_um=max(abs(value) for value in learned.values_um),
        over=learned.over,
        errors_um=list(learned.errors_um),
        kept=held is not None and held.helps,
        before_um=None if held is None else held.before_um,
        after_um=None if held is None else held.after_um,
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
