"""One case from its first tick to its last."""

from functools import cache, lru_cache
from typing import Any

import numpy as np

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.laws import law as control_law
from pincette.control.laws.definition import LawDefinition
from pincette.control.planning.contact_line import ContactLine
from pincette.control.planning.program import Program
from pincette.control.stability.tracks import law_step
from pincette.sim.plant import plant
from pincette.sim.plant.contact import cube_root
from pincette.sim.plant.drive import electrical
from pincette.sim.plant.joined_arms import tips
from pincette.sim.plant.noise import GaussianNoise
from pincette_batch.cases import Case, Run
from pincette_batch.compiling import as_record, compiled, of_the_library
from pincette_batch.kernel import law, loop
from pincette_batch.kernel import plant as arms
from pincette_batch.kernel.constants import Floats, Inverse
from pincette_batch.kernel.lane import COLUMNS, FORCE, LANE, SEGMENT, Ending
from pincette_batch.kernel.plant import Moved
from pincette_batch.prepared import PreparedRig, drifts_um, law_of, most_ticks, play_of
from pincette_batch.zeroing import Memory, Zeroing


def checked(_quantity: str, value: float, _unit: str) -> float:
    """In place of a check: what the kernel is given was checked when it was made."""
    return value


CHECKED = {require_positive: checked, require_not_negative: checked}
JOINED = {
    arms.arms_passed: arms.joined_arms_passed,
    arms.true_force_mN: arms.joined_true_force_mN,
}
"""For arms with modes of their own."""


def law_in(definition: LawDefinition) -> dict[Any, Any]:
    """The law's own functions, in place of those that stand for them in a kernel."""
    return {law.start: definition.start, law_step: definition.step}


@cache
def kernel(definition: LawDefinition, *, elaborate: bool) -> Any:
    """The compiled loop of a law; raises CompilerMissingError.

    ``elaborate``: with arms that have modes of their own, else with one mode against a spring.
    """
    instead = {**CHECKED, **law_in(definition), cube_root: of_the_library("cbrt")}
    return compiled(loop.play, {**instead, **(JOINED if elaborate else {})})


def play_lane(prepared: PreparedRig, case: Case) -> Run:
    """Play a case that the kernel follows; ``Run.ending`` says where it ends.

    Raises
    ------
    ValueError
        Where the law cannot be made.
    """
    rig, program = prepared.rig, case.program
    ticks = most_ticks(program, rig.rig.period_s)
    built = law_of(rig, program)
    unpoled = prepared.config.response.memory
    at_rest = control_law.start(
        built, x_um=0.0, x_r_um=0.0, force_mN=0.0, applied_V=0.0, memory=unpoled
    )
    lane = np.zeros(1, LANE)[0]
    memory = Memory(
        np.array(unpoled.plays_V),
        np.array(unpoled.creep_um),
        np.zeros((len(COLUMNS), ticks)),
        np.zeros(ticks),
    )
    begun = plant.start()
    elaborate = prepared.parameters.elaborate
    at = tips(begun) if elaborate else (begun.x_um, begun.speed_um_per_s)
    moved = as_record(Moved(0.0, electrical(begun), begun.x_um, at))
    play = kernel(built.definition, elaborate=elaborate)
    inverse = Inverse(built.free is not None, 1.0 if built.free is None else built.free.um_per_V)
    played = as_record((play_of(rig, program), built.parameters, built.force, inverse))
    fixed = (*prepared.constants, *played)
    inner, line = as_record(at_rest.law), as_record(ContactLine())
    arrays = (
        memory.plays_V,
        memory.creep_um,
        noise_of(prepared, case, ticks),
        drifts_um(prepared, ticks),
        memory.columns,
        memory.displacements_um,
        np.empty((2, prepared.longest)),
    )
    zeroing = Zeroing(prepared)
    while lane["ending"] == Ending.NONE:
        moved, inner, line = play(*fixed, lane, moved, inner, line, *arrays)
        if lane["ending"] == Ending.ZERO:
            zeroing.answer(lane, memory)
    ending = Ending(int(lane["ending"]))
    if _may_touch(memory.columns[:, : int(lane["tick"])], program):
        ending = Ending.CONTACT
    phases = tuple(segment.phase for segment in program.segments)
    outcome = outcome_of(program) if ending is Ending.DONE else ending.name.lower()
    return Run(ending, outcome, memory.columns[:, : int(lane["tick"])], phases)


def _may_touch(columns: Floats, program: Program) -> bool:
    """Whether a guard of free space may have acted: a lane knows the force, not its uncertainty."""
    guards, count, clear = program.guards, 0, False
    guarded = [segment.guarded for segment in program.segments]
    for number, force_mN in zip(columns[SEGMENT].tolist(), columns[FORCE].tolist(), strict=True):
        if not guarded[int(number)]:
            count, clear = 0, False
        elif abs(force_mN) < guards.contact_force_mN:
            count, clear = 0, True
        elif clear:
            count += 1
            if count >= guards.contact_samples:
                return True
    return False


def outcome_of(program: Program) -> str:
    """What a program that has come to its end has reached, as the controller says it."""
    for segment in program.segments:
        if segment.phase == "hold":
            return "gripped"
        if segment.kind == "path":
            return "tracked"
    return ""


def noise_of(prepared: PreparedRig, case: Case, ticks: int) -> Floats:
    """Standard normal numbers of a case's seed, one a tick."""
    simulation = prepared.rig.simulation
    drawn = 0 if simulation is None else simulation.seed
    return _noise(drawn if case.seed is None else case.seed, ticks)


@lru_cache(maxsize=64)
def _noise(seed: int, ticks: int) -> Floats:
    noise = GaussianNoise(seed)
    return np.array([noise.at(tick) for tick in range(ticks)])
