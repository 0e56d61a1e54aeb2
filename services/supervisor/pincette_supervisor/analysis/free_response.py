"""The free response out of a free motion: gain, loop, creep, and the model of both."""

import numpy as np

from pincette.api.calibration_models import Identified
from pincette.config import IdentifiedFreeResponse
from pincette.control.planning.calibration_programs import full_cycles
from pincette.control.planning.free_response_program import GAIN_CYCLES, PRESS_CYCLES
from pincette.control.response.free_calibration import FreeMotion, calibrate_free_response
from pincette_supervisor.analysis.findings import (
    Analysis,
    figure,
    identified,
    path_of,
    residuals,
    sure,
)
from pincette_supervisor.analysis.samples import Samples
from pincette_supervisor.model.quantities import UNITS
from pincette_supervisor.planning.planned import Planned

GAIN_DIFFERENCE = 0.01
"""Share by which the model's own gain may differ from the measured one before it is said."""


def free_response(planned: Planned, taken: Samples) -> Analysis:
    """Analyse the free motion; raises ValueError where it admits no model."""
    cycles, path = taken.of("cycles"), path_of(planned, "cycles")
    whole = full_cycles(path, taken.period_s, GAIN_CYCLES)
    presses, press_path = taken.of("presses"), path_of(planned, "presses")
    pressing = full_cycles(press_path, taken.period_s, PRESS_CYCLES)
    course, everything = taken.of("teach"), slice(0, taken.of("creep").stop)
    motion = FreeMotion(
        voltage_V=taken.filled(taken.voltage_V, everything, "free motion"),
        x_um=taken.filled(taken.x_um, everything, "free motion"),
        period_s=taken.period_s,
        course=slice(0, course.stop),
        cycles=slice(cycles.start + whole.start, cycles.start + whole.stop),
        presses=slice(presses.start + pressing.start, presses.start + pressing.stop),
        before_step=taken.of("before step"),
        after_step=taken.of("creep"),
    )
    found = calibrate_free_response(motion, path.cycle_s / taken.period_s)
    residual_um = max(found.model_residual_um, found.cycles_residual_um)
    table = IdentifiedFreeResponse.from_model(found.model, residual_um, found.press_gain)
    gain, off = found.gain, found.model_gain.gain_um_per_V / found.gain.gain_um_per_V - 1.0
    warnings = ()
    if abs(off) > GAIN_DIFFERENCE:
        warnings = (f"the model's own gain differs by {100.0 * off:+.1f} % from the measured one",)
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
        ),
        figures=(
            figure("loop", gain.loop_percent, "%", "width, of the stroke"),
            figure("stroke", gain.stroke_um, "µm", f"at {gain.voltage_pp_V:.2f} V peak to peak"),
            figure(
                "creep", found.creep.percent_per_decade, "%/decade", "of a step, per decade of time"
            ),
            figure(
                "press gain",
                found.press_gain,
                "1",
                "stroke over that of the model, where parts are pressed",
            ),
            figure(
                "model residual",
                residual_um,
                "µm",
                "r.m.s. of motion that the model was not fitted to",
            ),
        ),
        residuals=residuals("position about the model", "µm", left - np.mean(left)),
        statement=sure(
            gain.gain_um_per_V,
            gain.uncertainty_um_per_V,
            "µm/V",
            "of the scatter about settled cycles",
        ),
        drawn=found,
        warnings=warnings,
    )
