"""A short grip with two arms, in one process and virtual time, on a rig that a script disturbs."""

import tomllib
from collections.abc import Callable

from pincette.config import RigFile, parse_rig
from pincette.config.reading import laid_over
from pincette.control.planning.pair_plan import PairHold, PairRequest, grip_program
from pincette.control.planning.program import Program
from pincette.control.record import replace
from pincette.core.messages import GroundTruth, Message
from pincette.engine.composed import ComposedLoop
from pincette.engine.simulated import simulated_bench
from pincette.sim.bench import Bench
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.plugin.pair_plans import chosen_law
from tests.support.rigs import DEMO, Tree

TWO_ARMS = DEMO.with_name("two-arms.toml")
T = 0.02
FORCE_MN = 8.0
NEAR: Tree = {
    "safety": {"freeze_s": 0.4},
    "part": {"contact_um": 6.0, "contact_tolerance_um": 1.5},
    "second": {"contact_um": 6.0},
    "simulation": {
        "bead_contact_um": 6.2,
        "scripts": True,
        "second": {"bead_contact_um": 6.1},
    },
}
"""Changes to the rig: the part is near, and a freeze is short."""
SHORT_PAIR: Tree = {
    "grip": {
        "hold_s": 0.4,
        "load_s": 0.4,
        "approach_um_per_s": 20.0,
        "seek_um_per_s": 8.0,
        "zero_s": 0.24,
    },
    "simulation": {"pace": 1.0, "pair": {"lands": True}},
}
"""Further changes: grips as short as those of one arm, with a part that stays in place."""


def two_arm_rig(*changes: Tree, time: str = "lockstep") -> RigFile:
    """Return the rig of two arms, with its part near."""
    base, own = (tomllib.loads(path.read_text(encoding="utf-8")) for path in (DEMO, TWO_ARMS))
    del own["base"]
    tree = laid_over(laid_over(base, own), laid_over(NEAR, {"rig": {"time": time}}))
    for change in changes:
        tree = laid_over(tree, change)
    return parse_rig(tree)


def short_grip(rig: RigFile, hold_s: float = 1.0) -> Program:
    """Approach, touch from both sides, load, hold, unload and retreat."""
    assert rig.second is not None
    request = PairRequest(
        force_mN=FORCE_MN,
        load_s=0.5,
        approach_um_per_s=20.0,
        seek_um_per_s=8.0,
        contact_force_mN=2.0,
        zero_s=0.4,
        contacts_um=(rig.part.contact_um, rig.second.contact_um),
        contact_tolerance_um=rig.part.contact_tolerance_um,
        stiffness_mN_per_um=rig.part.stiffness_mN_per_um,
    )
    program = grip_program(request, PairHold(hold_s=hold_s), (0.0, 0.0), 40.0)
    law, _ = chosen_law(GripJobRequest(kind="grip"), rig)
    return replace(program, laws=(law,))


def play(*orders: Tree, changes: Tree | None = None) -> tuple[list[Message], Bench]:
    """Play the grip with a script of disturbances; returns the messages and the bench."""
    script: Tree = {"simulation": {"script": list(orders)}}
    rig = two_arm_rig(changes or {}, script)
    benches: list[Bench] = []

    def bench(publish: Callable[[GroundTruth], None]) -> Bench:
        benches.append(simulated_bench(rig, publish))
        return benches[-1]

    return ComposedLoop(rig, bench).play(short_grip(rig)), benches[0]
