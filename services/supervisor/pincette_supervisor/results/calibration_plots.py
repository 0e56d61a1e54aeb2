"""The picture of a calibration: what was measured, what was fitted, and what the fit leaves."""

from textwrap import shorten

import numpy as np

from pincette.api.calibration_models import CalibrationResult
from pincette.control.calibration.noise import Noise
from pincette.control.calibration.swept_mode import SweptMode
from pincette.control.calibration.weights import WeighedCompliance
from pincette.control.response.free_calibration import FreeCalibration
from pincette.records.columns import Columns
from pincette_supervisor.analysis.findings import Analysis, ContactFound
from pincette_supervisor.results import drawing
from pincette_supervisor.results.drawing import FAINT, MEASURED, REFERENCE, TRUE, Axis, Sheet
from pincette_supervisor.results.figures import Series, series

LEFT, RIGHT, TOP, BOTTOM = 0.085, 0.985, 0.89, 0.065
BINS = 60
WIDEST = 150
"""Letters of a statement that have room."""
DOT = {"linestyle": "none", "marker": "o", "markersize": 5.0}


def picture(
    table: Columns, result: CalibrationResult, analysis: Analysis | None, *, name: str
) -> bytes:
    """Draw a calibration as a PNG of 1400 by 1180 pixels.

    Parameters
    ----------
    table
        Columns of the epoch; drawn over time where there is no analysis.
    name
        Of the job and its rig, for the corner.
    """
    sheet = Sheet()
    match None if analysis is None else analysis.drawn:
        case Noise() as found:
            _noise(sheet, found)
        case WeighedCompliance() as found:
            _compliance(sheet, found)
        case FreeCalibration() as found:
            _free_response(sheet, found)
        case ContactFound() as found:
            _contact(sheet, found)
        case SweptMode() as found:
            _bode(sheet, found)
        case None:
            _course(sheet, table)
    title = result.calibration.replace("_", " ")
    if analysis is None:
        title += ": no values"
    sheet.head(LEFT, title, shorten(result.statement or result.outcome, WIDEST), name)
    return sheet.png()


def _axes(sheet: Sheet, rows: int, columns: int = 1) -> list[Axis]:
    found = sheet.figure.subplots(rows, columns, squeeze=False)
    sheet.figure.subplots_adjust(
        left=LEFT, right=RIGHT, top=TOP, bottom=BOTTOM, hspace=0.24, wspace=0.2
    )
    return list(found.flat)


def _zero(axis: Axis) -> None:
    axis.axhline(0.0, color=FAINT, linewidth=0.7, zorder=1)


def _noise(sheet: Sheet, found: Noise) -> None:
    trace, spread = _axes(sheet, 2)
    drawing.prepare(trace, "position less drift / µm", "time / s")
    drawing.line(trace, found.t_s, found.deviation_um, MEASURED, "readings", width=0.7)
    _zero(trace)
    drawing.prepare(spread, "readings", "position less drift / µm")
    spread.hist(found.deviation_um, bins=BINS, color=MEASURED)
    for side in (-1.0, 1.0):
        spread.axvline(side * found.noise_um, color=REFERENCE, linewidth=1.2)


def _compliance(sheet: Sheet, found: WeighedCompliance) -> None:
    line, left = _axes(sheet, 2)
    drawing.prepare(line, "deflection / µm", "weight / mN")
    line.plot(found.weight_mN, found.sag_um, color=MEASURED, label="measured", **DOT)
    ends = np.array([0.0, float(np.max(found.weight_mN))])
    fitted = found.compliance_um_per_mN * ends
    drawing.line(line, ends, fitted, REFERENCE, "$s_p F$", dashed=True)
    drawing.legend(line)
    drawing.prepare(left, "residual / µm", "weight / mN")
    left.plot(found.weight_mN, found.residuals_um, color=MEASURED, **DOT)
    _zero(left)


def _free_response(sheet: Sheet, found: FreeCalibration) -> None:
    course, loop, left, creep = _axes(sheet, 2, 2)
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
    drawing.prepare(left, "measured less model / µm", "time / s")
    drawing.line(left, found.t_s, found.x_um - found.model_um, MEASURED, "", width=0.7)
    _zero(left)
    drawing.prepare(creep, "creep: residual of the line / µm", "sample after the step")
    drawing.line(
        creep,
        np.arange(len(found.creep.line.residuals), dtype=np.float64),
        np.asarray(found.creep.line.residuals, dtype=np.float64),
        MEASURED,
        "",
        width=0.7,
    )
    _zero(creep)


def _contact(sheet: Sheet, found: ContactFound) -> None:
    line, left, loops, touch = _axes(sheet, 2, 2)
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
    _zero(left)
    drawing.prepare(loops, "force / mN", "position / µm")
    for level in levels:
        label = f"{level.level_V:g} V"
        loops.plot(level.x_cycle_um, level.force_cycle_mN, linewidth=1.0, label=label)
    drawing.legend(loops)
    met = found.touch
    order = np.argsort(met.free_um)
    drawing.prepare(touch, "free less measured / µm", "free position / µm")
    drawing.line(touch, met.free_um[order], met.lack_um[order], MEASURED, "approach", width=0.8)
    drawing.line(touch, met.free_um[order], met.fitted_um[order], TRUE, "first touch")
    drawing.legend(touch)


def _bode(sheet: Sheet, found: SweptMode) -> None:
    magnitude, phase = _axes(sheet, 2)
    for axis, label, measured, fitted in (
        (magnitude, "magnitude / dB of 1 µm/V", found.magnitude_db, found.model_magnitude_db),
        (phase, "phase / °", found.phase_deg, found.model_phase_deg),
    ):
        drawing.prepare(axis, label, "frequency / Hz")
        axis.set_xscale("log")
        drawing.line(axis, found.frequency_hz, measured, MEASURED, "measured", width=0.9)
        drawing.line(axis, found.frequency_hz, fitted, REFERENCE, "model", dashed=True)
        drawing.legend(axis)


def _course(sheet: Sheet, table: Columns) -> None:
    """Position and voltage over time, of a calibration that gave no values."""
    position, voltage = _axes(sheet, 2)
    t_s: Series = series(table, "t_s")
    drawing.prepare(position, "position / µm")
    drawing.line(position, t_s, series(table, "x_um"), MEASURED, "$x$ measured")
    drawing.prepare(voltage, "voltage / V", "time / s")
    drawing.line(voltage, t_s, series(table, "voltage_V"), MEASURED, "$u$ applied")
