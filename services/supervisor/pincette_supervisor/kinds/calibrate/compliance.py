"""Program, analysis and plot of the compliance of the arm."""

from math import floor, log10, sqrt

import numpy as np
from msgspec.structs import replace

from pincette.config import RigFile, derived
from pincette.control.calibration.weights import WeighedCompliance, weighed_compliance
from pincette.control.planning.calibration_programs import compliance_program, there_and_back
from pincette_supervisor.kinds.calibrate.calibration import (
    Analysis,
    CalibrationFunctions,
    CalibrationProgram,
    Samples,
    figure,
    identified,
    require_like_in_use,
    residuals,
    samples,
    sure,
)
from pincette_supervisor.kinds.calibrate.requests import ComplianceRequest, WeighedStep
from pincette_supervisor.plugin import ModelInUse, Present, Run, Wait, drawing
from pincette_supervisor.plugin.drawing import DOT, MEASURED, REFERENCE, Sheet

ROOM_SHARE = 0.5
"""Share of the limits of force and position that default weights may use."""
ROUND_DIGITS = (1.0, 2.0, 5.0)
WEIGHT_SHARES = (0.25, 0.5, 1.0)
SEGMENTS = 3
"""Segments of a weight: hang, settle, measure."""
SAME_V = 1e-3
"""Difference below which voltages count as equal, in V."""
SURE = 10.0
"""Smallest ratio of a compliance to its standard uncertainty."""


def program(request: ComplianceRequest, model: ModelInUse, _present: Present) -> CalibrationProgram:
    """Plan a wait and a reading for each weight, ascending then descending, except for weights that
    were already read.
    """
    weights_mN = request.weights_mN or weights_within(model.rig)
    steps, taken = there_and_back(weights_mN), len(request.taken)
    if taken >= len(steps):
        raise ValueError(f"{taken} steps taken of {len(steps)}: there is nothing left to weigh")
    made = compliance_program(derived.planned_rig(model.rig), weights_mN)
    made = replace(made, segments=made.segments[SEGMENTS * taken :])
    waiting = [number for number, segment in enumerate(made.segments) if segment.duration_s is None]
    waits = {
        number: Wait(_instruction(weight_mN), weight_mN)
        for number, weight_mN in zip(waiting, steps[taken:], strict=True)
    }
    values = {
        "weights_mN": list(weights_mN),
        "weight_uncertainty": request.weight_uncertainty,
        "taken": [step.model_dump() for step in request.taken],
    }
    return made, values, waits


def weights_within(rig: RigFile) -> list[float]:
    """Return weights from 0 to the largest of 1, 2, 5, 10, … mN that is within half of the limits.

    The other half is reserved for an arm that is softer than in the model in use.
    """
    limits, s_p = rig.limits, rig.model.compliance_um_per_mN
    room_mN = (derived.X_START_UM - limits.position_min_um) / s_p
    most_mN = ROOM_SHARE * min(limits.force_max_mN, room_mN)
    if most_mN <= 0.0:
        raise ValueError(
            f"limits.position_min_um = {limits.position_min_um:g} µm leaves no room for a weight, "
            f"which bends the arm below {derived.X_START_UM:g} µm: lower it"
        )
    decade = 10.0 ** floor(log10(most_mN))
    top_mN = max(digit * decade for digit in ROUND_DIGITS if digit * decade <= most_mN)
    return [0.0, *(float(f"{share * top_mN:.6g}") for share in WEIGHT_SHARES)]


def _instruction(weight_mN: float) -> str:
    return f"hang {weight_mN:g} mN on the tip" if weight_mN else "take every weight off the tip"


def analyse(run: Run) -> Analysis:
    """Fit positions under weights; raises ValueError if they do not lie on a line."""
    planned = run.planned
    steps = there_and_back(planned.values["weights_mN"])
    read = [WeighedStep(**step) for step in planned.values.get("taken", [])]
    taken = samples(run.table, run.period_s)
    read += [_reading(taken, number) for number in range(len(read) + 1, len(steps) + 1)]
    x_um, t_s = [one.x_um for one in read], [one.at_s for one in read]
    scatter = [one.scatter_um for one in read]
    found = weighed_compliance(
        steps,
        x_um,
        t_s,
        noise_um=sqrt(float(np.mean(np.square(scatter)))),
        weight_uncertainty=planned.values["weight_uncertainty"],
    )
    s_p, u = found.compliance_um_per_mN, found.uncertainty_um_per_mN
    if s_p < SURE * u:
        raise ValueError(
            f"compliance of {s_p:.4f} µm/mN with a standard uncertainty of {u:.4f} µm/mN, "
            f"but must be at least {SURE:g} times that: were the weights hung as requested?"
        )
    require_like_in_use(planned.model, "model.compliance_um_per_mN", s_p)
    return Analysis(
        values=(identified("model.compliance_um_per_mN", s_p, u),),
        figures=(
            figure("rest", found.rest_um, "µm", "without a weight"),
            figure("drift", found.drift_um_per_s, "µm/s", "of the arm"),
        ),
        residuals=residuals("position", "µm", found.residuals_um),
        statement=sure(s_p, u, "µm/mN", "from the scatter about the line and the stated weights"),
        drawn=found,
    )


def _reading(taken: Samples, number: int) -> WeighedStep:
    """Return mean position, its uncertainty and time under a weight; raises ValueError."""
    place = taken.of(f"measure {number}")
    values = taken.filled(taken.x_um, place, f"weight {number}")
    return WeighedStep(
        x_um=float(np.mean(values)),
        scatter_um=float(np.std(values)) / sqrt(len(values)),
        at_s=0.5 * (place.start + place.stop) * taken.period_s,
    )


def goes_on(request: ComplianceRequest, run: Run) -> tuple[ComplianceRequest, str]:
    """Keep the complete readings, and continue with the next weight.

    Each weight is a separate reading of an arm that only the weight moves. This holds only if the
    arm was at the safe voltage, to which the trip has set it; otherwise the measurement starts
    again.
    """
    weights_mN: list[float] = run.planned.values["weights_mN"]
    count = len(there_and_back(weights_mN))
    taken = samples(run.table, run.period_s)
    end_s = len(taken.x_um) * run.period_s
    read = list(request.taken)
    while f"hang {len(read) + 2}" in taken.phase:
        number = len(read) + 1
        stood_V = taken.voltage_V[taken.of(f"measure {number}")]
        if not np.nanmax(np.abs(stood_V - run.rig.safety.safe_V)) <= SAME_V:
            repeated = request.model_copy(update={"taken": [], "weights_mN": weights_mN})
            return (
                repeated,
                "begins again with the first weight, since the arm was at another voltage",
            )
        try:
            read.append(_reading(taken, number))
        except ValueError:
            break
    read = [one.model_copy(update={"at_s": one.at_s - end_s}) for one in read]
    after = request.model_copy(update={"taken": read, "weights_mN": weights_mN})
    return after, f"goes on with weight {len(read) + 1} of {count}"


def draw(sheet: Sheet, found: WeighedCompliance) -> None:
    """Draw weights and deflections."""
    line, left = drawing.grid(sheet, 2)
    drawing.prepare(line, "deflection / µm", "weight / mN")
    line.plot(found.weight_mN, found.sag_um, color=MEASURED, label="measured", **DOT)
    ends = np.array([0.0, float(np.max(found.weight_mN))])
    fitted = found.compliance_um_per_mN * ends
    drawing.line(line, ends, fitted, REFERENCE, "$s_p F$", dashed=True)
    drawing.legend(line)
    drawing.prepare(left, "residual / µm", "weight / mN")
    left.plot(found.weight_mN, found.residuals_um, color=MEASURED, **DOT)
    drawing.zero_line(left)


FUNCTIONS = CalibrationFunctions(
    program=program,
    goes_on=goes_on,
    analyse=analyse,
    draw=draw,
    finds=("model.compliance_um_per_mN",),
    needs=("part_removed", "weights"),
)
