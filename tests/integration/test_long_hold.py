"""A hold of a minute in one process: the drift of the estimate and its stated uncertainty."""

from math import fsum
from pathlib import Path

import pytest

from pincette.config import RigFile, read_rig
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Move, Press, Rest, Seek
from pincette.core.messages import Estimate, GroundTruth, Message, Telemetry
from pincette.engine.composed import ComposedLoop

DEMO = Path(__file__).parents[2] / "deploy/rigs/demo.toml"
FORCE_MN, HOLD_S = 20.0, 60.0
PROGRAM = Program(
    segments=(
        Rest("zero", 0.4),
        Move("approach", 2.5, to_um=(26.0,)),
        Rest("approach", 0.4),
        Seek("contact", 2.5, to_um=(36.0,)),
        Press("load", 2.0, to_mN=FORCE_MN),
        Press("hold", HOLD_S, to_mN=FORCE_MN, move_s=0.3),
    ),
    guards=Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.9, 1.0),
    contact_stiffness_mN_per_um=2.17,
)


def demo_rig(seed: int) -> RigFile:
    rig = read_rig(DEMO)
    assert rig.simulation is not None
    changes = {
        "rig": rig.rig.model_copy(update={"time": "lockstep"}),
        "simulation": rig.simulation.model_copy(update={"seed": seed}),
    }
    return rig.model_copy(update=changes)


def errors_mN(published: list[Message], *phases: str) -> list[tuple[float, float]]:
    """Return error and stated uncertainty of the estimate for each sample of some phases."""
    estimates = {message.seq: message for message in published if isinstance(message, Estimate)}
    truths = {message.seq: message for message in published if isinstance(message, GroundTruth)}
    return [
        (
            estimates[message.seq].arms[0].force_mN - truths[message.seq].arms[0].force_mN,
            estimates[message.seq].arms[0].force_uncertainty_mN,
        )
        for message in published
        if isinstance(message, Telemetry) and message.phase in phases and message.seq in truths
    ]


@pytest.mark.parametrize("seed", [1, 2])
def test_the_stated_uncertainty_covers_the_drift_of_a_long_hold(seed: int) -> None:
    published = ComposedLoop(demo_rig(seed)).play(PROGRAM)
    found = errors_mN(published, "approach", "contact", "load", "hold")
    covered = [abs(error) <= stated for error, stated in found]
    hold = errors_mN(published, "hold")
    assert len(hold) > 0.99 * HOLD_S / 0.02
    first, last = ([error for error, _ in part] for part in (hold[:50], hold[-50:]))
    drift_mN = fsum(last) / len(last) - fsum(first) / len(first)
    share = covered.count(True) / len(covered)
    print(
        f"seed {seed}: drift {drift_mN:+.2f} mN in {HOLD_S:.0f} s, stated {hold[-1][1]:.2f} mN, "
        f"covered {100 * share:.1f} %"
    )
    assert share >= 0.9
    assert abs(drift_mN) < hold[-1][1] + hold[0][1]
    # The uncertainty must not cover the error by being too large.
    assert hold[0][1] < 0.15 * FORCE_MN
    assert hold[-1][1] > hold[0][1]
