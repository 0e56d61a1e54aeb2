"""Program, analysis and plot of the noise of the sensor."""

from pincette.control.calibration.noise import Noise, sensor_noise
from pincette.control.planning.calibration_programs import noise_program
from pincette_supervisor.kinds.calibrate.calibration import (
    Analysis,
    CalibrationFunctions,
    CalibrationProgram,
    figure,
    identified,
    residuals,
    samples,
    sure,
)
from pincette_supervisor.kinds.calibrate.requests import NoiseRequest
from pincette_supervisor.plugin import ASSUMED, ModelInUse, Present, Run, drawing
from pincette_supervisor.plugin.drawing import MEASURED, REFERENCE, Sheet

BINS = 60
DRIFT = "sensor.drift_um_per_min"
SURE = 2.0
"""Number of standard uncertainties that are added to the slope."""


def program(request: NoiseRequest, _model: ModelInUse, _present: Present) -> CalibrationProgram:
    """Hold the voltage and read the sensor."""
    return noise_program(request.duration_s), {"duration_s": request.duration_s}, {}


def analyse(run: Run) -> Analysis:
    """Analyse readings at rest; raises ValueError if they are too few or all equal."""
    taken = samples(run.table, run.period_s)
    x_um = taken.filled(taken.x_um, taken.of("noise"), "noise")
    found = sensor_noise(x_um, taken.period_s, run.planned.model.rig.model.force_filter_s)
    warnings = ()
    if found.quantised:
        warnings = (
            f"the step of {found.step_um:g} µm hides the noise: choose a finer display or range",
        )
    drift_um_per_min, u_um_per_min = _drift_um_per_min(found, run.planned.model)
    return Analysis(
        values=(
            identified("sensor.noise_um", found.noise_um, found.noise_uncertainty_um),
            identified(DRIFT, drift_um_per_min, u_um_per_min),
        ),
        figures=(
            figure("step", found.step_um, "µm", "taken from the readings"),
            figure(
                "resolution",
                found.resolution_um,
                "µm",
                (
                    "smallest motion that one reading shows: width that contains 99.9 % of "
                    "the readings"
                ),
            ),
            figure(
                "filtered resolution",
                found.filtered_resolution_um,
                "µm",
                "resolution of readings averaged by the filter of the law",
            ),
            figure("drift", found.drift_um_per_s, "µm/s", "taken from the readings"),
        ),
        residuals=residuals("position", "µm", found.deviation_um),
        statement=sure(
            found.noise_um,
            found.noise_uncertainty_um,
            "µm",
            "from the readings about their drift; no shape of their distribution is assumed",
        ),
        drawn=found,
        warnings=warnings,
    )


def _drift_um_per_min(found: Noise, model: ModelInUse) -> tuple[float, float]:
    """Return the largest drift that the readings permit, |slope| + 2·u, and u, the standard
    uncertainty of the slope. The drift includes creep of the arm, since both look the same at rest.
    If the rig file states a larger drift, that value is kept, since a rest of seconds cannot
    exclude it.
    """
    u_um_per_min = 60.0 * found.drift_uncertainty_um_per_s
    drift_um_per_min = 60.0 * abs(found.drift_um_per_s) + SURE * u_um_per_min
    if model.calibration.sources.get(DRIFT, ASSUMED) == ASSUMED:
        drift_um_per_min = max(drift_um_per_min, model.rig.sensor.drift_um_per_min)
    return drift_um_per_min, u_um_per_min


def draw(sheet: Sheet, found: Noise) -> None:
    """Draw the readings over time and their distribution."""
    trace, spread = drawing.grid(sheet, 2)
    drawing.prepare(trace, "position minus drift / µm", "time / s")
    drawing.line(trace, found.t_s, found.deviation_um, MEASURED, "readings", width=0.7)
    drawing.zero_line(trace)
    drawing.prepare(spread, "readings", "position minus drift / µm")
    spread.hist(found.deviation_um, bins=BINS, color=MEASURED)
    for side in (-1.0, 1.0):
        spread.axvline(side * found.noise_um, color=REFERENCE, linewidth=1.2)


FUNCTIONS = CalibrationFunctions(
    program=program, analyse=analyse, draw=draw, finds=("sensor.noise_um", DRIFT)
)
