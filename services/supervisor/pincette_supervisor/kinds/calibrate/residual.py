"""Program, analysis and plot of the residual of a motion that is replayed without the part."""

from dataclasses import dataclass
from math import hypot

import numpy as np

from pincette.api.calibrations import Identified
from pincette.config import FreeResidual, RigFile, derived
from pincette.control.planning.recorded_motion import (
    Pressed,
    RecordedMotion,
    chained,
    recorded_program,
)
from pincette.control.response.contact_check import ContactScatter, contact_scatter
from pincette.control.response.residual_identification import (
    IdentifiedResidual,
    Place,
    identify_residual,
)
from pincette.control.response.residual_table import ResidualTable
from pincette.engine.timing_budget import stated_output
from pincette.records.columns import Columns
from pincette_supervisor.kinds.calibrate.calibration import (
    Analysis,
    CalibrationFunctions,
    CalibrationProgram,
    figure,
    residuals,
)
from pincette_supervisor.kinds.calibrate.requests import ResidualRequest
from pincette_supervisor.plugin import (
    RESIDUALS,
    UNITS,
    FaultyRequestError,
    ModelInUse,
    Present,
    Run,
    Wait,
    drawing,
)
from pincette_supervisor.plugin.drawing import FAINT, MEASURED, REFERENCE, Sheet
from pincette_supervisor.plugin.figures import Series, series

AWAY = "remove the part; nothing may touch the arm. Then continue"
BACK = "put the part back in its place. Then continue"
MOST_MISSING = 0.02
"""Share of the ticks of a run that may lack a sample."""


def program(request: ResidualRequest, model: ModelInUse, present: Present) -> CalibrationProgram:
    """Replay the recorded voltages, run after run."""
    motion, rig = present.recorded, model.rig
    if motion is None:
        raise FaultyRequestError(
            "/of_job", "grip or track first: this calibration replays a recorded job"
        )
    made, begins = recorded_program(
        motion,
        derived.planned_rig(rig),
        runs=request.runs,
        contact_force_mN=rig.grip.contact_force_mN,
        waits=request.confirm,
    )
    waits: dict[int, Wait] = {}
    if request.confirm:
        waits = {0: Wait(AWAY), len(made.segments) - 1: Wait(BACK)}
    values = {
        "of_job": motion.job,
        "motion": motion.program,
        "runs": list(begins),
        "ticks": [len(one.voltages_V) for one in motion.segments],
        "zeroes": [one.zeroes for one in motion.segments],
        "ring_um": _ring_um(motion, rig),
        "pressed": [list(one) for one in motion.pressed],
    }
    return made, values, waits


@dataclass(frozen=True, slots=True)
class Drawn:
    """Data for the plot."""

    t_s: Series
    runs_um: list[Series]
    residual_um: Series
    begins_s: list[float]
    """Start of each segment, in s."""


def analyse(run: Run) -> Analysis:
    """Compute the residual of the model; raises ValueError if something was in contact with the
    arm."""
    values, rig = run.planned.values, run.planned.model.rig
    places = [
        Place(segment, tick)
        for segment, ticks in enumerate(values["ticks"])
        for tick in range(1, ticks + 1)
    ]
    rest = _rest(places, values["zeroes"], run.period_s)
    runs_um = [_residual_um(run.table, begin, places, rest, rig) for begin in values["runs"]]
    s_p, noise_um = rig.model.compliance_um_per_mN, rig.sensor.noise_um
    contact_mN = rig.grip.contact_force_mN
    largest_mN = max(float(np.abs(one).max()) for one in runs_um) / s_p
    if largest_mN >= contact_mN:
        raise ValueError(
            f"the free arm seemed to press with {largest_mN:.2f} mN; from {contact_mN:g} mN "
            "on, contact is assumed: remove the part and repeat the run"
        )
    found = identify_residual(places, runs_um, noise_um)
    scatter = _scatter(values["pressed"], found.table, s_p)
    if scatter is not None and scatter.worse:
        raise ValueError(
            f"the table would not help: with it, the force of job {values['of_job']}, which "
            f"was not used to make it, scatters by {scatter.with_mN:.3f} mN about the line "
            f"of the part, and by {scatter.without_mN:.3f} mN without it. Nothing is stored. "
            "Fit an RC of 3.3 ms before the amplifier, set [output] shaping = true, or move "
            "more slowly"
        )
    error_um = hypot(found.error_um, values["ring_um"])
    # Both compared values, the error with the table and without it, contain the noise of the
    # sensor.
    missed_um = max(0.0, float(np.mean(np.square(runs_um))) - noise_um**2) ** 0.5
    if not error_um < missed_um:
        raise ValueError(
            "the table would not help: in a run that was not used to make it, the error is "
            f"{error_um:.3f} µm with it and {missed_um:.3f} µm without it. Nothing is stored"
        )
    if scatter is not None:
        # Error of the model in a later job, as far as the pressed part shows it. The noise of a
        # position counts twice: it changes the force, and the position on the line.
        noise_seen_um = (1.0 + rig.stiffness_ratio) * noise_um
        seen_um = max(0.0, (s_p * scatter.with_mN) ** 2 - noise_seen_um**2) ** 0.5
        error_um = max(error_um, seen_um)
    table = FreeResidual(
        program=values["motion"],
        response=rig.model.response_digest(),
        job=values["of_job"],
        stride_ticks=found.table.stride,
        values_um=found.table.knots_um,
        error_um=error_um,
    )
    rms_um = float(np.sqrt(np.mean(found.residual_um**2)))
    return Analysis(
        values=(
            Identified(
                quantity=RESIDUALS,
                value=[table.model_dump(mode="json")],
                unit=UNITS[RESIDUALS],
                uncertainty=error_um,
            ),
        ),
        figures=(
            figure("missed", rms_um, "µm", "r.m.s. error of the free response along this motion"),
            figure("missed force", rms_um / s_p, "mN", "the same error as a force"),
            figure("error", error_um, "µm", "error that is left in a later run"),
            figure("error of the force", error_um / s_p, "mN", "the same error as a force"),
            figure("smoothing", found.width_ticks * run.period_s, "s", "width of the Gaussian"),
        ),
        residuals=residuals(
            "runs about their smoothed mean",
            "µm",
            np.concatenate([one - found.residual_um for one in runs_um]),
        ),
        statement=(
            f"along job {values['of_job']} the error of the free response is {rms_um:.3f} µm "
            f"({rms_um / s_p:.2f} mN) r.m.s.; with the table {error_um:.3f} µm "
            f"({error_um / s_p:.2f} mN) are left"
        ),
        drawn=_drawn(run, places, runs_um, found),
    )


def _scatter(
    pressed: list[list[float]], table: ResidualTable, compliance_um_per_mN: float
) -> ContactScatter | None:
    """Return the scatter of the force in the recorded job without the table and with it."""
    samples = [Pressed(int(one[0]), int(one[1]), one[2], one[3]) for one in pressed]
    known = [(one, table.at(one.segment, one.tick)) for one in samples]
    rows = [
        (one.x_um, one.force_mN, found.value_um / compliance_um_per_mN)
        for one, found in known
        if found is not None
    ]
    if not rows:
        return None
    x_um, force_mN, correction_mN = zip(*rows, strict=True)
    return contact_scatter(x_um, force_mN, correction_mN)


def _ring_um(motion: RecordedMotion, rig: RigFile) -> float:
    """Return the r.m.s. uncertainty of a free arm due to oscillation of the mode, along the motion.

    The table contains the oscillation of the free arm, which a pressed arm does not have.
    """
    steps_V = np.diff(np.concatenate([np.asarray(one.voltages_V) for one in motion.segments]))
    if not steps_V.size:
        return 0.0
    shares = derived.ring_shares(rig, stated_output(rig))
    steps_um = rig.model.piezo_um_per_V * float(np.sqrt(np.mean(steps_V**2)))
    return shares.free * steps_um / (1.0 - shares.kept)


def _rest(places: list[Place], zeroes: list[bool], period_s: float) -> slice:
    """Return the ticks of the rest in which the recorded job took its last zero."""
    if not any(zeroes):
        raise ValueError("the recorded job never zeroed its force")
    last = len(zeroes) - 1 - zeroes[::-1].index(True)
    end = max(number for number, place in enumerate(places) if place.segment == last)
    return slice(max(0, end - derived.rest_samples(period_s)), end)


def _residual_um(
    table: Columns, begin: int, places: list[Place], rest: slice, rig: RigFile
) -> Series:
    """Return the residual of one run at each of its ticks.

    Position x_k is caused by the voltage of the previous tick.
    """
    s_p, period_s = rig.model.compliance_um_per_mN, rig.rig.period_s
    numbers, ticks = series(table, "segment"), series(table, "segment_tick")
    missed_um = -s_p * series(table, "force_mN")
    fresh = series(table, "zero_age_s") < 0.5 * period_s
    answer = {
        (int(segment) - begin, int(tick)): place + 1
        for place, (segment, tick) in enumerate(zip(numbers, ticks, strict=True))
        if not (np.isnan(segment) or np.isnan(tick)) and place + 1 < len(numbers)
    }
    rows = [answer.get((place.segment, place.tick), -1) for place in places]
    found = np.array([np.nan if row < 0 else missed_um[row] for row in rows])
    zeroed = [row >= 0 and bool(fresh[row]) for row in rows]
    gaps = np.isnan(found)
    if gaps.mean() > MOST_MISSING:
        raise ValueError(f"{int(gaps.sum())} of {len(found)} samples of a run are missing")
    grid = np.arange(len(found))
    found = np.interp(grid, grid[~gaps], found[~gaps])
    if not any(zeroed):
        raise ValueError("the force could not be zeroed: nothing would have shown a touch")
    residual_um = np.asarray(chained(found.tolist(), zeroed, derived.rest_samples(period_s)))
    counted: Series = residual_um - float(np.mean(residual_um[rest]))
    return counted


def _drawn(
    run: Run, places: list[Place], runs_um: list[Series], found: IdentifiedResidual
) -> Drawn:
    t_s: Series = np.arange(len(places), dtype=np.float64) * run.period_s
    begins_s = [place * run.period_s for place, one in enumerate(places) if one.tick == 1]
    return Drawn(t_s, runs_um, found.residual_um, begins_s)


def draw(sheet: Sheet, found: Drawn) -> None:
    """Draw the residual of each run, and the stored values."""
    residual, left = drawing.grid(sheet, 2)
    drawing.prepare(residual, "measured minus model / µm")
    drawing.prepare(left, "runs minus their smoothed mean / µm", "time / s")
    for number, one in enumerate(found.runs_um):
        label = "runs" if number == 0 else ""
        drawing.line(residual, found.t_s, one, MEASURED, label, width=0.6)
        drawing.line(left, found.t_s, one - found.residual_um, MEASURED, "", width=0.6)
    drawing.line(residual, found.t_s, found.residual_um, REFERENCE, "kept", width=1.4)
    drawing.legend(residual)
    for axis in (residual, left):
        drawing.zero_line(axis)
        for t_s in found.begins_s:
            axis.axvline(t_s, color=FAINT, linewidth=0.6, zorder=0)


FUNCTIONS = CalibrationFunctions(
    program=program,
    analyse=analyse,
    draw=draw,
    assumes=("model.compliance_um_per_mN", "model.free_response"),
    finds=(RESIDUALS,),
    of_bring_up=False,
)
