"""Program, analysis and plot of a gain check: the motion after conditioning strokes."""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from pincette.api.calibrations import Identified
from pincette.config import IdentifiedFreeResponse, RigFile, derived
from pincette.control.force.estimation import COVERAGE
from pincette.control.planning.calibration_programs import free_program
from pincette.control.planning.conditioning import REST_S, stroke_stops
from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.segments import Drive, Follow
from pincette.control.response.conditioned_branch import past_creep_mN
from pincette.control.response.free_response import FreeSample, rest_mean
from pincette.control.response.identified_response import IdentifiedResponse
from pincette.control.response.stroke_check import (
    SIGMAS,
    Base,
    MeasurementErrors,
    StrokeChange,
    rest_base,
    stroke_change,
)
from pincette_supervisor.kinds.calibrate.calibration import (
    Analysis,
    CalibrationFunctions,
    CalibrationProgram,
    Samples,
    figure,
    identified,
    residuals,
    samples,
    sure,
)
from pincette_supervisor.kinds.calibrate.requests import GainCheckRequest
from pincette_supervisor.plugin import UNITS, FaultyRequestError, ModelInUse, Present, Run, drawing
from pincette_supervisor.plugin.drawing import MEASURED, Sheet
from pincette_supervisor.plugin.figures import Series
from pincette_supervisor.plugin.plans import SPEED_FACTOR

WAYS = 2
"""Number of measured motions, each after conditioning strokes."""
HIGH = 0.5
"""Final voltage of a motion, as a fraction of the highest voltage of the identification."""
HIGH_S, BACK_S = 1.0, 0.4
"""Duration of the rest at the end of a motion, and of the rest after the return, in s."""


def program(_request: GainCheckRequest, model: ModelInUse, present: Present) -> CalibrationProgram:
    """Condition the arm and move it to a voltage, twice."""
    rig = model.rig
    taught = _taught(rig)
    branch, limits = taught.branch, rig.limits
    if branch is None or taught.taught_V is None or branch.voltages_V[0] < limits.voltage_min_V:
        raise FaultyRequestError(
            "/calibration",
            "gain_check compares the motion after conditioning strokes with that of the "
            "calibration, but the model in use has no such motion within the voltage "
            "limits: calibrate free_response",
        )
    low_V, high_V = branch.voltages_V[0], HIGH * taught.taught_V[1]
    rate = SPEED_FACTOR * rig.grip.approach_um_per_s / rig.model.piezo_um_per_V
    begins_V = present.stand_V(rig)
    parts: list[Drive] = []
    for number in range(1, WAYS + 1):
        first, *stops = stroke_stops(low_V, limits.slew_V_per_s, branch.strokes)
        *stops, last = stops
        start = [] if begins_V == first[0] else [(begins_V, rate, 0.0)]
        strokes = voltage_moves([*start, (0.0, rate, 0.0), *stops, (0.0, last[1], REST_S)])
        way = voltage_moves([(0.0, rate, 0.0), (high_V, rate, HIGH_S)])
        back = voltage_moves([(high_V, rate, 0.0), (rig.safety.safe_V, rate, BACK_S)])
        begins_V = rig.safety.safe_V
        parts += [
            Drive(f"{what} {number}", path.duration_s, courses=(Follow(path),))
            for what, path in (("strokes", strokes), ("way", way), ("go back", back))
        ]
    return free_program(*parts), {"low_V": low_V, "high_V": high_V}, {}


def _taught(rig: RigFile) -> IdentifiedFreeResponse:
    taught = rig.model.free_response
    if taught is None:
        raise FaultyRequestError(
            "/calibration",
            "gain_check needs an identified free response: calibrate free_response first",
        )
    return taught


@dataclass(frozen=True, slots=True)
class Drawn:
    """Data for the plot."""

    t_s: Series
    left_um: Series


def analyse(run: Run) -> Analysis:
    """Compare the motions; raises ValueError if the arm was not conditioned."""
    rig = run.planned.model.rig
    taught, taken = _taught(rig), samples(run.table, run.period_s)
    found, left_um = _changes(rig, taken)
    change = float(np.mean([one.change for one in found]))
    standard = found[-1].limit / SIGMAS / sqrt(2.0 * len(found))
    factor, d_p = 1.0 + change, rig.model.piezo_um_per_V
    return Analysis(
        values=(
            identified("model.piezo_um_per_V", factor * d_p, standard * d_p),
            Identified(
                quantity="model.free_response",
                value=taught.stroked(factor, d_p).model_dump(mode="json"),
                unit=UNITS["model.free_response"],
                uncertainty=taught.residual_um,
            ),
        ),
        figures=(
            figure("change", 100.0 * change, "%", "change of the stroke since its calibration"),
            figure(
                "limit",
                100.0 * found[-1].limit,
                "%",
                "change up to which noise and repeatability explain it",
            ),
        ),
        residuals=residuals("changes of the ways", "1", [one.change - change for one in found]),
        statement=sure(
            100.0 * change,
            100.0 * standard,
            "%",
            (
                "change of the stroke; accept it if the amplifier or the piezo is the "
                "cause, not the sensor"
            ),
        ),
        drawn=Drawn(np.arange(len(left_um), dtype=np.float64) * run.period_s, left_um),
    )


def _changes(rig: RigFile, taken: Samples) -> tuple[list[StrokeChange], Series]:
    """Return the change of each motion, and the position minus the model over all samples."""
    response = derived.free_response(rig.model)
    assert isinstance(response, IdentifiedResponse)
    last = taken.of(f"go back {WAYS}").stop
    u = taken.filled(taken.voltage_V, slice(0, last), "gain check")
    x = taken.filled(taken.x_um, slice(0, last), "gain check")
    begins, ends = (
        {taken.of(f"{what} {number}").stop - 1 for number in range(1, WAYS + 1)}
        for what in ("strokes", "way")
    )
    count, free = derived.rest_samples(taken.period_s), list[FreeSample]()
    found: list[StrokeChange] = []
    base: Base | None = None
    for place, (voltage_V, x_um) in enumerate(zip(u.tolist(), x.tolist(), strict=True)):
        response = response.updated(voltage_V, taken.period_s)
        free.append(response.sample(x_um))
        if place in begins:
            base = rest_base(response, rest_mean(free, count), count)
        if place in ends:
            found.append(_change(rig, response, base, rest_mean(free, count), count))
    return found, np.array([one.x_um - one.displacement_um for one in free])


def _change(
    rig: RigFile, response: IdentifiedResponse, base: Base | None, rest: FreeSample, count: int
) -> StrokeChange:
    s_p, since_s = rig.model.compliance_um_per_mN, response.strokes.since_s
    past_um = s_p * past_creep_mN(since_s) / COVERAGE
    doubt = MeasurementErrors(rig.sensor.noise_um, rig.sensor.drift_um_per_min / 60.0, past_um)
    found = None if base is None else stroke_change(response, base, rest, count, doubt)
    if found is None:
        raise ValueError(
            "a motion did not begin with full strokes, or the sensor's noise and drift are "
            "too large for a comparison: repeat the gain check"
        )
    return found


def draw(sheet: Sheet, found: Drawn) -> None:
    """Draw the position minus the model."""
    (left,) = drawing.grid(sheet, 1)
    drawing.prepare(left, "measured minus model / µm", "time / s")
    drawing.line(left, found.t_s, found.left_um, MEASURED, "", width=0.7)


FUNCTIONS = CalibrationFunctions(
    program=program,
    analyse=analyse,
    draw=draw,
    assumes=("model.free_response",),
    finds=("model.piezo_um_per_V", "model.free_response"),
    of_bring_up=False,
)
