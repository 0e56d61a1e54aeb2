"""Program, analysis and plot of a sweep, which identifies the mode of the arm."""

from math import pi

from pincette.config import RigFile, derived
from pincette.control.arm.shaping import shaping_interval_s
from pincette.control.calibration.swept_mode import SweptMode, require_even_swing, swept_mode
from pincette.control.planning.calibration_programs import frequency_response_program
from pincette.engine.timing_budget import budget
from pincette.instruments.protocols import Timing
from pincette_supervisor.kinds.calibrate.calibration import (
    Analysis,
    CalibrationFunctions,
    CalibrationProgram,
    acquisition,
    figure,
    identified,
    require_like_in_use,
    residuals,
    sure,
)
from pincette_supervisor.kinds.calibrate.requests import FrequencyResponseRequest, bursts_are_needed
from pincette_supervisor.plugin import (
    InstrumentBandwidth,
    ModelInUse,
    Present,
    Run,
    UnsupportedError,
    drawing,
)
from pincette_supervisor.plugin.drawing import MEASURED, REFERENCE, Sheet

SWING_SHARE = 0.5
"""Share of the distance to the nearest position limit that the amplitude at resonance may use."""


def program(
    request: FrequencyResponseRequest, model: ModelInUse, _present: Present
) -> CalibrationProgram:
    """Sweep a sine through the resonance."""
    rig = model.rig
    _require_sweep(rig, request.to_hz, request.capture_hz)
    amplitude_V = request.amplitude_V or sweep_amplitude_V(model)
    made = frequency_response_program(
        derived.planned_rig(rig),
        amplitude_V=amplitude_V,
        damping_ratio=rig.model.damping_ratio,
        rate_hz=request.capture_hz,
        rest_V=rig.safety.safe_V,
        from_hz=request.from_hz,
        to_hz=request.to_hz,
        duration_s=request.duration_s,
    )
    values = request.model_dump(include={"from_hz", "to_hz", "duration_s", "capture_hz"})
    return made, {**values, "amplitude_V": amplitude_V}, {}


def sweep_amplitude_V(model: ModelInUse) -> float:
    """Return the sweep's amplitude, in V: its limit, or less if the resonance needs more room."""
    limits, arm = model.rig.limits, model.rig.model
    room_um = min(limits.position_max_um, -limits.position_min_um)
    swing_V = 2.0 * arm.damping_ratio * SWING_SHARE * room_um / arm.piezo_um_per_V
    return min(limits.sweep_V, swing_V)


def _require_sweep(rig: RigFile, to_hz: float, capture_hz: float) -> None:
    """Reject a frequency response for which the instruments are too slow.

    The mode is identified from samples at no less than four times its highest frequency;
    acquisition and output are buffered, so their clocks do not wait for the loop.

    Raises
    ------
    UnsupportedError
        With the available bandwidth, and each instrument's contribution to it.
    """
    timing = budget(rig)
    parts = (
        _part("sensor", rig.sensor.driver, timing.sensors[0]),
        _part("output", rig.output.driver, timing.outputs[0]),
    )
    faults = [_fault(part, capture_hz) for part in parts]
    bandwidth_hz = timing.bandwidth_hz
    if bandwidth_hz < to_hz:
        faults.append(f"both together reach {bandwidth_hz:.1f} Hz, {to_hz:g} Hz are needed")
    faults = [fault for fault in faults if fault]
    if faults:
        model = rig.model
        raise UnsupportedError(
            f"{'; '.join(faults)}. model.natural_frequency_rad_per_s = "
            f"{model.natural_frequency_rad_per_s:g} rad/s and model.damping_ratio = "
            f"{model.damping_ratio:g} stay as the rig file has them, assumed",
            to_hz,
            bandwidth_hz,
            parts,
        )


def _part(name: str, driver: str, timing: Timing) -> InstrumentBandwidth:
    return InstrumentBandwidth(
        name,
        driver,
        timing.bandwidth_hz,
        timing.buffered_hz,
        timing.exchange_s,
        timing.response_s,
        timing.note,
    )


def _fault(part: InstrumentBandwidth, rate_hz: float) -> str:
    what = "acquisition" if part.part == "sensor" else "output"
    if part.buffered_hz is None:
        return f"{part.part} ({part.driver}): no buffered {what}"
    if part.buffered_hz < rate_hz:
        return (
            f"{part.part} ({part.driver}): buffered {what} at {part.buffered_hz:g} Hz at most, "
            f"{rate_hz:g} Hz are needed"
        )
    return ""


def analyse(run: Run) -> Analysis:
    """Analyse a sweep; raises ValueError if it shows no resonance."""
    acquired = acquisition(run.messages)
    if acquired is None:
        raise ValueError("the sensor has acquired nothing from its buffer")
    values = run.planned.values
    require_even_swing(acquired.x_um, acquired.rate_hz)
    found = swept_mode(
        acquired.drive_V,
        acquired.x_um,
        acquired.rate_hz,
        from_hz=values["from_hz"],
        to_hz=values["to_hz"],
    )
    model = found.model
    require_like_in_use(
        run.planned.model,
        "model.natural_frequency_rad_per_s",
        model.natural_frequency_rad_per_s,
    )
    omega_n, u = model.natural_frequency_rad_per_s, model.natural_frequency_uncertainty_rad_per_s
    return Analysis(
        values=(
            identified("model.natural_frequency_rad_per_s", omega_n, u),
            identified("model.damping_ratio", model.damping_ratio, model.damping_ratio_uncertainty),
        ),
        figures=(
            figure(
                "natural frequency", omega_n / (2.0 * pi), "Hz", "natural frequency of the mode"
            ),
            figure(
                "small-signal gain",
                found.small_signal_gain_um_per_V,
                "µm/V",
                f"at {values['amplitude_V']:g} V, below d_p for the hysteresis",
            ),
            figure("delay", 1e3 * found.delay_s, "ms", "from drive to reading"),
            figure(
                "shaping interval",
                1e3 * shaping_interval_s(omega_n, run.planned.model.rig.stiffness_ratio),
                "ms",
                "between the parts of a step, where [output] shaping is on",
            ),
            figure(
                "coherence",
                found.coherence,
                "1",
                "share of the motion that the drive explains, median",
            ),
        ),
        residuals=residuals("log of the gain", "1", model.residuals),
        statement=sure(omega_n, u, "rad/s", "from the scatter of the gain about the model"),
        drawn=found,
    )


def draw(sheet: Sheet, found: SweptMode) -> None:
    """Draw magnitude and phase over frequency."""
    magnitude, phase = drawing.grid(sheet, 2)
    for axis, label, measured, fitted in (
        (magnitude, "magnitude / dB of 1 µm/V", found.magnitude_db, found.model_magnitude_db),
        (phase, "phase / °", found.phase_deg, found.model_phase_deg),
    ):
        drawing.prepare(axis, label, "frequency / Hz")
        axis.set_xscale("log")
        drawing.line(axis, found.frequency_hz, measured, MEASURED, "measured", width=0.9)
        drawing.line(axis, found.frequency_hz, fitted, REFERENCE, "model", dashed=True)
        drawing.legend(axis)


def _moves_fast(rig: RigFile) -> bool:
    """Return whether the estimator models the mode; a quasi-static one does not.

    ``output_timing`` identifies the mode if bursts at the period of the loop show it.
    """
    return rig.model.force_observer != "quasi_static" and not bursts_are_needed(rig)


FUNCTIONS = CalibrationFunctions(
    program=program,
    analyse=analyse,
    draw=draw,
    finds=("model.natural_frequency_rad_per_s", "model.damping_ratio"),
    needed=_moves_fast,
)
