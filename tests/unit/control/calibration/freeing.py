"""The free motion of a bench, and its calibration."""

from functools import cache

from pincette.config import Simulation, derived
from pincette.control.planning.calibration_programs import full_cycles
from pincette.control.planning.free_response_program import (
    GAIN_CYCLES,
    GAIN_HZ,
    free_response_program,
)
from pincette.control.response.free_calibration import (
    FreeCalibration,
    FreeMotion,
    calibrate_free_response,
)

from .bench import DEMO, PERIOD_S, Bench, drawn

SAMPLES_PER_CYCLE = 1.0 / (GAIN_HZ * PERIOD_S)


def freed(simulation: Simulation) -> tuple[Bench, FreeMotion]:
    """Move an arm that touches nothing over the voltages of a grip."""
    bench = Bench(simulation.model_copy(update={"bead": False}))
    rig = derived.planned_rig(DEMO)
    program = free_response_program(rig, from_V=-0.3, to_V=3.5, rate_V_per_s=3.2)
    places = bench.play(program.segments)
    path = program.segments[1].path
    assert path is not None
    cycles, at = full_cycles(path, PERIOD_S, GAIN_CYCLES), places["cycles"]
    return bench, FreeMotion(
        bench.voltage_V,
        bench.x_um,
        PERIOD_S,
        course=places["teach"],
        cycles=slice(at.start + cycles.start, at.start + cycles.stop),
        before_step=places["before step"],
        after_step=places["creep"],
    )


@cache
def free_calibration(seed: int) -> FreeCalibration:
    """Calibration of a rig drawn at random."""
    _, motion = freed(drawn(seed))
    return calibrate_free_response(motion, SAMPLES_PER_CYCLE, unpoled=False)
