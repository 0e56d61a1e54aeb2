"""The free motion of a bench, and its calibration."""

from functools import cache, partial

import pytest

from pincette.config import Simulation, derived
from pincette.control.planning.calibration_programs import full_cycles
from pincette.control.planning.free_response_program import (
    GAIN_CYCLES,
    GAIN_HZ,
    PRESS_CYCLES,
    free_response_program,
    rehearsed_grips,
)
from pincette.control.planning.segments import paths_of
from pincette.control.response import free_calibration as calibration
from pincette.control.response.free_calibration import (
    FreeCalibration,
    FreeMotion,
    calibrate_free_response,
)
from pincette.control.response.identification import Candidates, identify_free_response

from .bench import DEMO, PERIOD_S, Bench, base, drawn

SAMPLES_PER_CYCLE = 1.0 / (GAIN_HZ * PERIOD_S)
FEW = Candidates(
    families=((0.0,), (0.7,)), curved=(False,), bent=(False,), ridges=(1e-6,), beside=()
)


def try_few_models(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a calibration choose among 2 models in place of 64."""
    few = partial(identify_free_response, candidates=FEW)
    monkeypatch.setattr(calibration, "identify_free_response", few)


def freed(simulation: Simulation, *, moved_before: bool = False) -> tuple[Bench, FreeMotion]:
    """Move a free arm over the voltages of a grip; with a history, once more."""
    bench = Bench(simulation.model_copy(update={"bead": False}))
    rig = derived.planned_rig(DEMO)
    program = free_response_program(rig, from_V=-0.3, to_V=3.5, rate_V_per_s=3.2, grip_V_per_s=6.3)
    if moved_before:
        bench.play(program.segments)
        del bench.voltage_V[:], bench.x_um[:]
    places = bench.play(program.segments)
    full: dict[str, slice] = {}
    for phase, count in (("cycles", GAIN_CYCLES), ("presses", PRESS_CYCLES)):
        (path,) = [path for one in program.segments if one.phase == phase for path in paths_of(one)]
        whole, at = full_cycles(path, PERIOD_S, count), places[phase]
        full[phase] = slice(at.start + whole.start, at.start + whole.stop)
    return bench, FreeMotion(
        bench.voltage_V,
        bench.x_um,
        PERIOD_S,
        course=places["teach"],
        cycles=full["cycles"],
        presses=full["presses"],
        before_step=places["before step"],
        after_step=places["creep"],
        grips=rehearsed_grips(places.__getitem__, program),
    )


@cache
def freed_demo() -> FreeMotion:
    """Return the motion of the demo rig; copies with replaced parts may be made, but it must not
    be changed."""
    return freed(base())[1]


@cache
def free_calibration(seed: int) -> FreeCalibration:
    """Return the calibration of a randomly drawn rig."""
    _, motion = freed(drawn(seed))
    return calibrate_free_response(motion, SAMPLES_PER_CYCLE, unpoled=False)
