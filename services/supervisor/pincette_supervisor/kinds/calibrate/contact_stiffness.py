"""Program, analysis and plot of a press at several levels: contact stiffness and position."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from pincette.config import RigFile, derived
from pincette.control.calibration.contact_stiffness import (
    ContactStiffness,
    Swing,
    contact_stiffness,
    with_press_gain,
)
from pincette.control.calibration.first_touch import FirstTouch, NoTouchError, first_touch
from pincette.control.planning.calibration_programs import full_cycles
from pincette.control.planning.contact_request import ContactRequest
from pincette.control.planning.contact_stiffness_program import (
    LEVEL_CYCLES,
    contact_stiffness_program,
    level_phase,
    levels_within,
)
from pincette_supervisor.kinds.calibrate.calibration import (
    Analysis,
    CalibrationFunctions,
    CalibrationProgram,
    Samples,
    figure,
    identified,
    path_of,
    residuals,
    samples,
    sure,
)
from pincette_supervisor.kinds.calibrate.requests import ContactStiffnessRequest
from pincette_supervisor.plugin import FaultyRequestError, ModelInUse, Present, Run, drawing
from pincette_supervisor.plugin.drawing import DOT, MEASURED, REFERENCE, TRUE, Sheet
from pincette_supervisor.plugin.plans import (
    CONTACT_FIELDS,
    contact_values,
    part_values,
    usual_conditioning_V,
)

EARLY_PRESSES = (3.0, 6.0, 12.0)
"""Candidate force limits for the search for the first contact, as multiples of the contact
force. Only the samples of a press below the limit are used. The smallest limit at which the contact
is certain is used, since faces that are not flat become stiffer with the force."""
BRING_UP_MIN = 10.0
"""Assumed age of the rig file's part position, in minutes, when this calibration begins: the
position is a sensor reading from the same bring-up, and the drift since then is added to its
tolerance.
"""


@dataclass(frozen=True, slots=True)
class ContactFound:
    """Results for the contact stiffness and for the first contact."""

    stiffness: ContactStiffness
    touch: FirstTouch


def program(
    request: ContactStiffnessRequest, model: ModelInUse, present: Present
) -> CalibrationProgram:
    """Press the part by a sinusoid of voltage at several levels; raises FaultyRequestError.

    No law limits the force of the press, and a straight-line model cannot predict it: without an
    identified response, 77 mN acted instead of the permitted 40 mN, on a part that was 7 µm too
    near.
    """
    rig = model.rig
    if rig.model.free_response is None:
        raise FaultyRequestError(
            "/calibration",
            "contact_stiffness presses by voltage, and the free response, from which the "
            "force is computed, is not identified: calibrate free_response first",
        )
    given = contact_values(request, CONTACT_FIELDS, rig)
    part = part_values(rig)
    part["contact_tolerance_um"] += rig.sensor.drift_um_per_min * BRING_UP_MIN
    contact = ContactRequest(**given, **part)
    planned = derived.planned_rig(rig, present.x_um, usual_conditioning_V(rig), present.rest_um())
    levels_V = tuple(request.levels_V or levels_within(contact, planned))
    made = contact_stiffness_program(contact, planned, levels_V)
    return made, {"levels_V": list(levels_V), **given}, {}


def analyse(run: Run) -> Analysis:
    """Analyse a press; raises ValueError if the contact was lost, or none was found."""
    taken, planned = samples(run.table, run.period_s), run.planned
    rig, values = planned.model.rig, planned.values
    s_p, free = rig.model.compliance_um_per_mN, rig.model.free_response
    swings: list[Swing] = []
    samples_per_cycle = 0.0
    for number, level_V in enumerate(values["levels_V"], start=1):
        path, begin = path_of(planned, level_phase(number)), taken.of(level_phase(number)).start
        whole = full_cycles(path, taken.period_s, LEVEL_CYCLES)
        place = slice(begin + whole.start, begin + whole.stop)
        what = f"level of {level_V:g} V"
        x_um = taken.filled(taken.x_um, place, what)
        force_mN = taken.filled(taken.force_mN, place, what)
        if free is not None:
            force_mN = with_press_gain(x_um, force_mN, s_p, free.press_gain)
        swings.append(Swing(level_V, x_um, force_mN))
        samples_per_cycle = path.cycle_s / taken.period_s
    found = contact_stiffness(
        swings,
        samples_per_cycle,
        compliance_um_per_mN=s_p,
        compliance_uncertainty_um_per_mN=(
            planned.model.uncertainties.get("model.compliance_um_per_mN") or 0.0
        ),
        free_errors_um=[_error_um(rig, level_V) for level_V in values["levels_V"]],
    )
    touch = _touch(taken, rig, values["contact_force_mN"])
    K_e, u = found.stiffness_mN_per_um, found.uncertainty_mN_per_um
    left = [level.residual_mN for level in found.levels]
    return Analysis(
        values=(
            identified("part.stiffness_mN_per_um", K_e, u),
            identified("part.contact_um", touch.contact_um, touch.uncertainty_um),
        ),
        figures=(
            figure("offset", found.line.offset, "mN", "force of the contact line (Fig. 8) at 0 µm"),
            figure(
                "scatter",
                found.scatter_mN_per_um,
                "mN/µm",
                "part of the uncertainty that comes from the residuals",
            ),
            figure(
                "first touch stiffness",
                touch.stiffness_mN_per_um,
                "mN/µm",
                "from the few µm after the touch; far less certain",
            ),
            *(
                figure(
                    f"level {place} left out",
                    level_V,
                    "V",
                    "peak to peak; the contact was lost at its trough",
                )
                for place, level_V in enumerate(found.lost_V, start=1)
            ),
        ),
        residuals=residuals("force, peak to peak", "mN", left),
        statement=sure(
            K_e,
            u,
            "mN/µm",
            "from the scatter and the stated uncertainties of compliance and free response",
        ),
        drawn=ContactFound(found, touch),
    )


def _touch(taken: Samples, rig: RigFile, contact_force_mN: float) -> FirstTouch:
    """Return the first contact, found with the smallest force limit of ``EARLY_PRESSES`` that shows
    it; raises ValueError.
    """

    def up_to(share: float) -> FirstTouch:
        place = _approach(taken, share * contact_force_mN)
        return first_touch(
            taken.filled(taken.x_um, place, "approach"),
            taken.filled(taken.force_mN, place, "approach"),
            rig.model.compliance_um_per_mN,
            _error_um(rig, float(np.ptp(taken.filled(taken.voltage_V, place, "approach")))),
        )

    *shorter, longest = EARLY_PRESSES
    for share in shorter:
        with suppress(NoTouchError):
            return up_to(share)
    return up_to(longest)


def _error_um(rig: RigFile, way_V: float) -> float:
    """Return the standard error of x_1 after a distance from a zero, in µm."""
    return derived.free_response(rig.model).begin(0.0).updated(way_V, 0.0).error_um()


def _approach(taken: Samples, up_to_mN: float) -> slice:
    """Return the samples of the seek, and of the press as long as the force is at most
    ``up_to_mN``.
    """
    begin, end = taken.of("contact").start, taken.of("press").stop
    beyond = np.flatnonzero(taken.force_mN[begin:end] > up_to_mN)
    return slice(begin, begin + int(beyond[0]) if len(beyond) else end)


def draw(sheet: Sheet, found: ContactFound) -> None:
    """Draw the oscillations of each level and the first contact."""
    line, left, loops, touch = drawing.grid(sheet, 2, 2)
    levels = found.stiffness.levels
    x_pp = np.array([level.x_pp_um for level in levels])
    drawing.prepare(line, "force / mN, peak to peak", "position / µm, peak to peak")
    force_pp = [level.force_pp_mN for level in levels]
    line.plot(x_pp, force_pp, color=MEASURED, label="measured", **DOT)
    ends = np.array([0.0, float(np.max(x_pp))])
    fitted = found.stiffness.stiffness_mN_per_um * ends
    drawing.line(line, ends, fitted, REFERENCE, "$K_e x_{pp}$", dashed=True)
    drawing.legend(line)
    drawing.prepare(left, "residual / mN", "position / µm, peak to peak")
    left.plot(x_pp, [level.residual_mN for level in levels], color=MEASURED, **DOT)
    drawing.zero_line(left)
    drawing.prepare(loops, "force / mN", "position / µm")
    for level in levels:
        label = f"{level.level_V:g} V"
        loops.plot(level.x_cycle_um, level.force_cycle_mN, linewidth=1.0, label=label)
    drawing.legend(loops)
    met = found.touch
    order = np.argsort(met.free_um)
    drawing.prepare(touch, "free minus measured / µm", "free position / µm")
    drawing.line(touch, met.free_um[order], met.lack_um[order], MEASURED, "approach", width=0.8)
    drawing.line(touch, met.free_um[order], met.fitted_um[order], TRUE, "first touch")
    drawing.legend(touch)


FUNCTIONS = CalibrationFunctions(
    program=program,
    analyse=analyse,
    draw=draw,
    assumes=("model.compliance_um_per_mN", "model.free_response"),
    finds=("part.stiffness_mN_per_um", "part.contact_um"),
    needs=("part_in_place",),
    meets_part=True,
)
