"""The rigs that are measured, from one mode to both arms with all that a part does."""

from msgspec.structs import replace

from pincette.config import RigFile
from pincette_batch.cases import Case, Run
from pincette_study.closed_loop import tracking_plan
from pincette_study.rigs import frozen_rig
from tests.support.laws import default_settings
from tests.support.rigs import Tree, demo_rig

SUBSTEP_S = 1e-4
STILL: Tree = {"creep_per_decade": 0.0}
TWO_MODES: Tree = {"second_mode": {"share": 0.0255}}
HERTZ: Tree = {"part": {"modulus_GPa": 37.95}}
PASSIVE: Tree = {"passive_natural_frequency_rad_per_s": 2437.8}
COUNTED = "both modes"
RIGS: dict[str, Tree] = {
    "one mode": STILL,
    "one mode, creep": {},
    COUNTED: {**TWO_MODES, **STILL},
    "both modes, creep": TWO_MODES,
    "both modes, Hertz": {**TWO_MODES, **STILL, **HERTZ},
    "both modes, Hertz, creep": {**TWO_MODES, **HERTZ},
    "both arms": {**TWO_MODES, **STILL, **PASSIVE},
    "both arms, Hertz, creep": {**TWO_MODES, **HERTZ, **PASSIVE},
}
"""All with hysteresis; without Hertz the part is rigid, and the contact that of the springs."""


def rig_of(changes: Tree, substep_s: float = SUBSTEP_S) -> RigFile:
    """The rig of the study, with other arms."""
    return frozen_rig(demo_rig({"simulation": {**changes, "substep_s": substep_s}}))


def case_of(rig: RigFile, seed: int = 1) -> Case:
    """The paper's sinusoid."""
    laws = (default_settings("pbsmic", "consistent").spec(),)
    return Case(rig, replace(tracking_plan(rig).program, laws=laws), seed)


def substeps(case: Case, run: Run) -> int:
    """Of the plant, all ticks together."""
    simulation = case.rig.simulation
    assert simulation is not None
    return run.columns.shape[1] * round(case.rig.rig.period_s / simulation.substep_s)
