"""Program, analysis and plot of the free response: gain, loop, creep, and the model of both."""

import numpy as np

from pincette.api.calibrations import Identified
from pincette.config import IdentifiedFreeResponse, RigFile, derived
from pincette.control.planning.calibration_programs import full_cycles
from pincette.control.planning.free_response_program import (
    GAIN_CYCLES,
    GAIN_PP_V,
    PRESS_CYCLES,
    conditioned_ways,
    free_response_program,
    rehearsed_grips,
)
from pincette.control.response.free_calibration import (
    FreeCalibration,
    FreeMotion,
    calibrate_free_response,
    kink_text,
)
from pincette_supervisor.kinds.calibrate.calibration import (
    Analysis,
    CalibrationFunctions,
    CalibrationProgram,
    figure,
    identified,
    path_of,
    require_like_in_use,
    residuals,
    samples,
    sure,
)
from pincette_supervisor.kinds.calibrate.requests import FreeResponseRequest
from pincette_supervisor.plugin import UNITS, ModelInUse, Present, Run, drawing
from pincette_supervisor.plugin.drawing import MEASURED, REFERENCE, Sheet
from pincette_supervisor.plugin.plans import GAIN_GROWTH, SPEED_FACTOR

BELOW_REST = 0.1
"""Depth of the free motion below the rest position, as a fraction of its height above that
position.
"""
LARGEST_GAIN = 1.6
"""Largest gain of an arm without a model, as a multiple of the assumed gain.

With this gain, the position limit determines the lowest voltage. Conditioning strokes must be deep,
but their exact depth does not matter.
"""
LESS = 0.8
"""Factor applied to the voltage, counted from rest, at which the arm exceeded a position limit."""
QUICKEST = 0.9
"""Fraction of the slew limit that a grip rehearsed at the speed of a quick grip may not exceed."""
GAIN_DIFFERENCE = 0.01
"""Relative difference between the gain of the model and the measured gain, above which a warning
is given."""


def program(
    request: FreeResponseRequest, model: ModelInUse, _present: Present
) -> CalibrationProgram:
    """Plan a motion over the voltages that a grip needs, if the request specifies no range."""
    rig = _within(model.rig, request)
    limits, d_p, rest_V = rig.limits, rig.model.piezo_um_per_V, rig.safety.safe_V
    high_V = request.high_V
    if high_V is None:
        most_V = rest_V + limits.position_max_um / (GAIN_GROWTH * d_p)
        high_V = min(limits.voltage_max_V, most_V, rest_V + _pressed_um(rig) / d_p)
    low_V = request.low_V
    if low_V is None:
        least_V = rest_V + limits.position_min_um / (GAIN_GROWTH * d_p)
        lowest_V = max(limits.voltage_min_V, least_V)
        low_V = max(lowest_V, rest_V - BELOW_REST * (high_V - rest_V))
    rate = request.rate_V_per_s or SPEED_FACTOR * rig.grip.approach_um_per_s / d_p
    quick = rig.grip.quick.approach_um_per_s / d_p
    made = free_response_program(
        derived.planned_rig(rig),
        from_V=low_V,
        to_V=high_V,
        rate_V_per_s=rate,
        rest_V=rest_V,
        grip_V_per_s=min(quick, QUICKEST * limits.slew_V_per_s),
        lowest_V=max(limits.voltage_min_V, rest_V + limits.position_min_um / (LARGEST_GAIN * d_p)),
    )
    values = {"low_V": low_V, "high_V": high_V, "rate_V_per_s": rate, "no_part": request.no_part}
    return made, values, {}


def _within(rig: RigFile, request: FreeResponseRequest) -> RigFile:
    """Return the rig with the voltages of the request as limits, if they are narrower."""
    limits = rig.limits
    least_V, most_V = limits.voltage_min_V, limits.voltage_max_V
    if request.least_V is not None:
        least_V = max(least_V, request.least_V)
    if request.most_V is not None:
        most_V = min(most_V, request.most_V)
    closer = {"voltage_min_V": least_V, "voltage_max_V": most_V}
    return rig.model_copy(update={"limits": limits.model_copy(update=closer)})


def _fitted_V(motion: FreeMotion) -> tuple[float, float]:
    """Return the lowest and the highest voltage of the section of the motion that is fitted."""
    voltages_V = motion.voltage_V[motion.course]
    return float(np.min(voltages_V)), float(np.max(voltages_V))


def moves_less(request: FreeResponseRequest, run: Run) -> tuple[FreeResponseRequest, str] | None:
    """Reduce the motion to ``LESS`` of the voltage at which the arm exceeded a position limit.

    The gain of an arm without a model may be 1.6 times the assumed one, and its remanence shifts
    the rest position. The result is None if there is no room for cycles of 2 V.
    """
    rig = _within(run.rig, request)
    taken, limits, rest_V = samples(run.table, run.period_s), rig.limits, rig.safety.safe_V
    low = np.flatnonzero(taken.x_um < limits.position_min_um)
    high = np.flatnonzero(taken.x_um > limits.position_max_um)
    least_V, most_V = limits.voltage_min_V, limits.voltage_max_V
    if len(low):
        least_V = rest_V + LESS * (float(taken.voltage_V[low[0]]) - rest_V)
    if len(high):
        most_V = rest_V + LESS * (float(taken.voltage_V[high[0]]) - rest_V)
    if not least_V <= rest_V <= most_V or most_V - least_V < GAIN_PP_V:
        return None
    less: dict[str, object] = {"least_V": least_V, "most_V": most_V}
    if request.low_V is not None:
        less["low_V"] = max(request.low_V, least_V)
    if request.high_V is not None:
        less["high_V"] = min(request.high_V, most_V)
    words = f"begins again and keeps to {least_V:.2f} V to {most_V:.2f} V"
    return request.model_copy(update=less), words


def _pressed_um(rig: RigFile) -> float:
    """Return the free travel that the grip needs for its force on the softest and furthest part, in
    µm.

    The arm presses with F at x_e + F/K_e; a free arm would be s_p·F further.
    """
    part, force_mN = rig.part, rig.grip.force_mN
    softest = part.stiffness_mN_per_um * (1.0 - part.stiffness_tolerance)
    pressed_um = part.contact_um + part.contact_tolerance_um + force_mN / softest
    return pressed_um + rig.model.compliance_um_per_mN * force_mN


def analyse(run: Run) -> Analysis:
    """Analyse the free motion; raises ValueError if no model can be identified from it."""
    taken, planned = samples(run.table, run.period_s), run.planned
    cycles, path = taken.of("cycles"), path_of(planned, "cycles")
    whole = full_cycles(path, taken.period_s, GAIN_CYCLES)
    presses, press_path = taken.of("presses"), path_of(planned, "presses")
    pressing = full_cycles(press_path, taken.period_s, PRESS_CYCLES)
    course, everything = (
        taken.of("teach"),
        slice(0, taken.of(planned.program.segments[-1].phase).stop),
    )
    motion = FreeMotion(
        voltage_V=taken.filled(taken.voltage_V, everything, "free motion"),
        x_um=taken.filled(taken.x_um, everything, "free motion"),
        period_s=taken.period_s,
        course=slice(0, course.stop),
        cycles=slice(cycles.start + whole.start, cycles.start + whole.stop),
        presses=slice(presses.start + pressing.start, presses.start + pressing.stop),
        before_step=taken.of("before step"),
        after_step=taken.of("creep"),
        grips=rehearsed_grips(taken.of, planned.program),
        conditioned=conditioned_ways(taken.of, planned.program),
    )
    found = calibrate_free_response(
        motion,
        path.cycle_s / taken.period_s,
        no_part=bool(planned.values.get("no_part")),
    )
    require_like_in_use(planned.model, "model.piezo_um_per_V", found.gain.gain_um_per_V)
    s_p = planned.model.rig.model.compliance_um_per_mN
    residual_um = max(found.model_residual_um, found.cycles_residual_um)
    table = IdentifiedFreeResponse.from_model(
        found.model,
        residual_um,
        found.press_gain,
        found.rehearsed.growth,
        _fitted_V(motion),
        creep_percent_per_decade=max(0.0, found.creep.percent_per_decade),
        return_error_um=found.return_error_um,
        turn_error_um_per_V=found.turn_error_um_per_V,
        branch=found.branch,
    )
    gain, off = found.gain, found.model_gain.gain_um_per_V / found.gain.gain_um_per_V - 1.0
    warnings: list[str] = []
    if abs(off) > GAIN_DIFFERENCE:
        warnings.append(
            f"the model's own gain differs by {100.0 * off:+.1f} % from the measured one"
        )
    if found.kink is not None:
        warnings.append(
            f"{kink_text(found.kink)}. You have confirmed that no part is in the gripper: if that "
            "is wrong, discard this calibration"
        )
    left = (found.x_um - found.model_um)[motion.cycles]
    return Analysis(
        values=(
            identified("model.piezo_um_per_V", gain.gain_um_per_V, gain.uncertainty_um_per_V),
            Identified(
                quantity="model.free_response",
                value=table.model_dump(mode="json"),
                unit=UNITS["model.free_response"],
                uncertainty=residual_um,
            ),
            identified("model.hysteresis_fraction", *found.line_error),
            identified(
                "model.creep_mN_per_decade",
                found.rehearsed.creep_um.value / s_p,
                found.rehearsed.creep_um.uncertainty / s_p,
            ),
            identified(
                "model.forgotten_mN",
                found.forgetting.full_um.value / s_p,
                found.forgetting.full_um.uncertainty / s_p,
            ),
            identified("model.forgotten_scale_V", *found.forgetting.scale_V),
        ),
        figures=(
            figure("loop", gain.loop_percent, "%", "width as a share of the stroke"),
            figure(
                "stroke",
                gain.stroke_um,
                "µm",
                f"stroke at {gain.voltage_pp_V:.2f} V peak to peak",
            ),
            figure(
                "creep",
                found.creep.percent_per_decade,
                "%/decade",
                "creep after a step, per decade of time",
            ),
            figure(
                "press gain",
                found.press_gain,
                "1",
                (
                    "measured stroke divided by that of the model, in the range where parts "
                    "are pressed"
                ),
            ),
            figure(
                "model residual",
                residual_um,
                "µm",
                "r.m.s. error of the model in a motion that it was not fitted to",
            ),
        ),
        residuals=residuals("position about the model", "µm", left - np.mean(left)),
        statement=sure(
            gain.gain_um_per_V,
            gain.uncertainty_um_per_V,
            "µm/V",
            "from the scatter of settled cycles",
        ),
        drawn=found,
        warnings=tuple(warnings),
    )


def draw(sheet: Sheet, found: FreeCalibration) -> None:
    """Draw the motion beside the model, the loop and the creep."""
    course, loop, left, creep = drawing.grid(sheet, 2, 2)
    drawing.prepare(course, "position / µm", "time / s")
    drawing.line(course, found.t_s, found.x_um, MEASURED, "measured", width=0.9)
    drawing.line(course, found.t_s, found.model_um, REFERENCE, "model", width=0.9, dashed=True)
    drawing.legend(course)
    drawing.make_room(course)
    drawing.prepare(loop, "position / µm", "voltage / V")
    for gain, color, label in (
        (found.gain, MEASURED, "measured"),
        (found.model_gain, REFERENCE, "model"),
    ):
        about_um = gain.x_cycle_um - float(np.mean(gain.x_cycle_um))
        dashed = label == "model"
        drawing.line(loop, gain.voltage_cycle_V, about_um, color, label, dashed=dashed)
    drawing.legend(loop)
    drawing.prepare(left, "measured minus model / µm", "time / s")
    drawing.line(left, found.t_s, found.x_um - found.model_um, MEASURED, "", width=0.7)
    drawing.zero_line(left)
    drawing.prepare(creep, "creep: residual of the line / µm", "sample after the step")
    drawing.line(
        creep,
        np.arange(len(found.creep.line.residuals), dtype=np.float64),
        np.asarray(found.creep.line.residuals, dtype=np.float64),
        MEASURED,
        "",
        width=0.7,
    )
    drawing.zero_line(creep)


FUNCTIONS = CalibrationFunctions(
    program=program,
    analyse=analyse,
    draw=draw,
    moves_less=moves_less,
    assumes=("model.compliance_um_per_mN",),
    finds=(
        "model.piezo_um_per_V",
        "model.free_response",
        "model.hysteresis_fraction",
        "model.creep_mN_per_decade",
        "model.forgotten_mN",
        "model.forgotten_scale_V",
    ),
)
