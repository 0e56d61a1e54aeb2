"""Identification of the free response of a simulated rig, as by the calibration ``free_response``.

The voltages and the identification are those of the calibration; no supervisor runs in a study.
"""

from pincette.config import IdentifiedFreeResponse, RigFile, derived
from pincette.control.planning.calibration_programs import (
    full_cycles,
)
from pincette.control.planning.free_response_program import (
    GAIN_CYCLES,
    PRESS_CYCLES,
    free_response_program,
    rehearsed_grips,
)
from pincette.control.planning.paths import Path
from pincette.control.planning.program import Program
from pincette.control.planning.segments import paths_of
from pincette.control.response.free_calibration import FreeMotion, calibrate_free_response
from pincette.core.messages import Estimate, Message, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette.engine.teaching import SPEED_FACTOR, free_range_um, without_part
from pincette_study.closed_loop import StudyError, outcome

LINE_ERROR = 0.5
"""Deviation of an unpoled arm's first stroke from a straight line that is allowed, as a fraction of
the travel.
"""


def with_calibrated_response(rig: RigFile) -> RigFile:
    """Move the arm without the part, and return the rig file with the identified model; raises
    ValueError.
    """
    d_p = rig.model.piezo_um_per_V
    low_V, high_V = (end_um / d_p for end_um in free_range_um(rig))
    program = free_response_program(
        derived.planned_rig(rig),
        from_V=low_V,
        to_V=high_V,
        rate_V_per_s=SPEED_FACTOR * rig.grip.approach_um_per_s / d_p,
    )
    motion = _motion(rig, program, ComposedLoop(_unknown(rig)).play(program))
    cycle_s = _path(program, "cycles").cycle_s
    found = calibrate_free_response(motion, cycle_s / rig.rig.period_s)
    residual_um = max(found.model_residual_um, found.cycles_residual_um)
    # The voltage range of the identification is not stored, since each arm of a study is new and
    # unpoled.
    table = IdentifiedFreeResponse.from_model(
        found.model, residual_um, found.press_gain, found.rehearsed.growth
    )
    update = {"free_response": table, "piezo_um_per_V": found.gain.gain_um_per_V}
    return rig.model_copy(update={"model": rig.model.model_copy(update=update)})


def _unknown(rig: RigFile) -> RigFile:
    """Return a rig without its part and with an uncertain line, so that no force is estimated."""
    free = without_part(rig)
    update = {"hysteresis_fraction": LINE_ERROR}
    return free.model_copy(update={"model": free.model.model_copy(update=update)})


def _motion(rig: RigFile, program: Program, messages: list[Message]) -> FreeMotion:
    """Return the samples of the motion by phase; ``voltage_V[k]`` is the voltage that caused
    ``x_um[k]``.
    """
    estimates = {m.seq: m for m in messages if isinstance(m, Estimate)}
    views = [m for m in messages if isinstance(m, Telemetry)]
    phases = [str(view.phase) for view in views]
    period_s = rig.rig.period_s

    def of(phase: str) -> slice:
        if phase not in phases:
            raise StudyError(f"the free motion has no {phase}: ended {outcome(messages)!r}")
        places = [place for place, name in enumerate(phases) if name == phase]
        return slice(places[0], places[-1] + 1)

    def whole(phase: str, cycles: int) -> slice:
        inner = full_cycles(_path(program, phase), period_s, cycles)
        return slice(of(phase).start + inner.start, of(phase).start + inner.stop)

    return FreeMotion(
        voltage_V=[estimates[view.seq].arms[0].applied_V for view in views],
        x_um=[estimates[view.seq].arms[0].x_um for view in views],
        period_s=period_s,
        course=slice(0, of("teach").stop),
        cycles=whole("cycles", GAIN_CYCLES),
        presses=whole("presses", PRESS_CYCLES),
        before_step=of("before step"),
        after_step=of("creep"),
        grips=rehearsed_grips(of, program),
    )


def _path(program: Program, phase: str) -> Path:
    return next(path for s in program.segments if s.phase == phase for path in paths_of(s))
