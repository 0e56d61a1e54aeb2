"""Program, analysis and plot of bursts at the period of the loop: delay and lag of the output."""

from dataclasses import dataclass
from math import pi

import numpy as np

from pincette.config import derived
from pincette.control.calibration.output_timing import Burst, IdentifiedTiming, output_timing
from pincette.control.calibration.visible_mode import NYQUIST_SHARE, require_visible
from pincette.control.planning.calibration_programs import BURSTS, output_timing_program
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
from pincette_supervisor.kinds.calibrate.frequency_response import sweep_amplitude_V
from pincette_supervisor.kinds.calibrate.requests import OutputTimingRequest, bursts_are_needed
from pincette_supervisor.plugin import ModelInUse, Present, Run, UnsupportedError, drawing
from pincette_supervisor.plugin.drawing import MEASURED, REFERENCE, Sheet
from pincette_supervisor.plugin.figures import Series

SLEW_SHARE = 0.45
"""Share of the slew limit that one burst step uses; a step from one side to the other uses twice
this."""
LEAST_EXPLAINED = 0.9
"""Smallest share of the bursts' variance that must be explained; an object in contact with the
arm lowers it."""


def program(
    request: OutputTimingRequest, model: ModelInUse, _present: Present
) -> CalibrationProgram:
    """Play bursts of voltages; raises UnsupportedError if the sampling does not resolve the
    mode."""
    rig = model.rig
    period_s = rig.rig.period_s
    omega_n = rig.model.natural_frequency_rad_per_s
    try:
        require_visible(omega_n, period_s)
    except ValueError as error:
        mode_hz, shown_hz = omega_n / (2.0 * pi), 0.5 * NYQUIST_SHARE / period_s
        raise UnsupportedError(str(error), mode_hz, shown_hz, ()) from error
    most_V = SLEW_SHARE * rig.limits.slew_V_per_s * period_s
    amplitude_V = request.amplitude_V or min(sweep_amplitude_V(model), most_V)
    made = output_timing_program(
        derived.planned_rig(rig),
        amplitude_V=amplitude_V,
        damping_ratio=rig.model.damping_ratio,
        rest_V=rig.safety.safe_V,
    )
    return made, {"amplitude_V": amplitude_V, "rest_V": rig.safety.safe_V}, {}


@dataclass(frozen=True, slots=True)
class Drawn:
    """Data for the plot."""

    period_s: float
    found: IdentifiedTiming


def analyse(run: Run) -> Analysis:
    """Identify delay, lag and mode; raises ValueError if the bursts do not show them."""
    rest_V, period_s = run.planned.values["rest_V"], run.period_s
    taken = samples(run.table, period_s)
    bursts = [_burst(taken, f"burst {number + 1}", rest_V) for number in range(BURSTS)]
    found = output_timing(bursts, period_s)
    if found.explained < LEAST_EXPLAINED:
        raise ValueError(
            f"one mode explains {100.0 * found.explained:.1f} % of the motion, must be at "
            f"least {100.0 * LEAST_EXPLAINED:g} %: a part seems to be in the way: remove it "
            "and calibrate again"
        )
    omega_n = found.natural_frequency_rad_per_s
    require_like_in_use(run.planned.model, "model.natural_frequency_rad_per_s", omega_n)
    if found.delay_s > period_s:
        raise ValueError(
            f"a voltage is put out {1000.0 * found.delay_s:.3f} ms after its sample, limit: "
            f"the period of {1000.0 * period_s:g} ms: choose a longer period or faster "
            "instruments"
        )
    return Analysis(
        values=(
            identified(
                "model.natural_frequency_rad_per_s",
                omega_n,
                found.natural_frequency_uncertainty_rad_per_s,
            ),
            identified("model.damping_ratio", found.damping_ratio, found.damping_ratio_uncertainty),
            identified("model.output_delay_s", found.delay_s, found.delay_uncertainty_s),
            identified("model.output_lag_s", found.lag_s, found.lag_uncertainty_s),
        ),
        figures=(
            figure(
                "natural frequency", omega_n / (2.0 * pi), "Hz", "natural frequency of the mode"
            ),
            figure(
                "delay and lag",
                1e3 * (found.delay_s + found.lag_s),
                "ms",
                "sum of delay and lag; if the lag found is 0, more certain than either of them",
            ),
            figure("delay", found.delay_s / period_s, "1", "from sample to voltage, in periods"),
            figure(
                "small-signal gain",
                found.gain_um_per_V,
                "µm/V",
                f"at {run.planned.values['amplitude_V']:g} V, below d_p for the hysteresis",
            ),
            figure("explained", found.explained, "1", "share of the motion that the fit explains"),
        ),
        residuals=residuals("position", "µm", np.concatenate(found.residual_um)),
        statement=_statement(found),
        drawn=Drawn(period_s, found),
    )


def _statement(found: IdentifiedTiming) -> str:
    of = "from the scatter between bursts and the loss of the hysteresis"
    if found.lag_s > 0.0:
        lag_ms, error_ms = 1e3 * found.lag_s, 1e3 * found.lag_uncertainty_s
        of = f"{of}; lag {lag_ms:.3g} ± {2.0 * error_ms:.2g} ms"
    else:
        of = (
            f"{of} and from a possible lag of up to {1000.0 * found.lag_uncertainty_s:.2g} "
            "ms; no lag was seen"
        )
    return sure(1e3 * found.delay_s, 1e3 * found.delay_uncertainty_s, "ms", of)


def _burst(taken: Samples, phase: str, rest_V: float) -> Burst:
    """Return samples of one burst, and the voltages that caused them."""
    place = taken.of(phase)
    taken.filled(taken.x_um, place, phase)  # raises ValueError if too many are missing
    return Burst(_answers(taken, place) - rest_V, taken.x_um[place])


def _answers(taken: Samples, place: slice) -> Series:
    """Return the voltages that caused the samples of a burst; for an unknown one, the last known
    voltage."""
    found = taken.voltage_V[place.start + 1 : place.stop + 1].copy()
    for number in np.flatnonzero(np.isnan(found)):
        found[number] = found[number - 1] if number else taken.voltage_V[place.start]
    return found


def draw(sheet: Sheet, drawn: Drawn) -> None:
    """Draw the measured first burst, and the residuals of all bursts."""
    found = drawn.found
    burst, left = drawing.grid(sheet, 2)
    seen, missed = found.moved_um[0], found.residual_um[0]
    t_ms = 1e3 * drawn.period_s * np.arange(len(seen), dtype=np.float64)
    drawing.prepare(burst, "position minus slow motion / µm", "time in the first burst / ms")
    drawing.line(burst, t_ms, seen, MEASURED, "measured", width=0.8)
    drawing.line(burst, t_ms, seen - missed, REFERENCE, "model", dashed=True, width=0.8)
    drawing.legend(burst)
    all_um = np.concatenate(found.residual_um)
    drawing.prepare(left, "measured minus model / µm", "sample")
    drawing.line(left, np.arange(len(all_um), dtype=np.float64), all_um, MEASURED, "", width=0.5)
    drawing.zero_line(left)


FUNCTIONS = CalibrationFunctions(
    program=program,
    analyse=analyse,
    draw=draw,
    finds=(
        "model.natural_frequency_rad_per_s",
        "model.damping_ratio",
        "model.output_delay_s",
        "model.output_lag_s",
    ),
    needed=bursts_are_needed,
)
