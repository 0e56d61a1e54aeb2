"""Whole grips of an arm with relays, in one process."""

from math import fsum

import pytest

from pincette.config import RigFile
from pincette.core.messages import GroundTruth, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.rigs import demo_rig


@pytest.fixture
def rig() -> RigFile:
    relays = {"loop_share": 0.15, "full_drive_V": 2.5, "centre_V": 1.0}
    return demo_rig({"simulation": {"hysteresis": None, "relays": relays}}, time="lockstep")


def test_the_true_held_force_depends_on_the_hysteresis_class_of_the_simulated_arm(
    rig: RigFile,
) -> None:
    """The model that was fitted to the other class still holds the part, with a different error."""

    def held_mN(of: RigFile) -> float:
        published = ComposedLoop(of).play(plan_job(GripJobRequest(kind="grip"), of).program)
        views = [message for message in published if isinstance(message, Telemetry)]
        assert views[-1].outcome == "gripped"
        hold = {view.seq for view in views if view.phase == "hold"}
        forces_mN = [
            m.arms[0].force_mN for m in published if isinstance(m, GroundTruth) and m.seq in hold
        ]
        return fsum(forces_mN) / len(forces_mN)

    force_mN = held_mN(rig)
    assert 15.0 < force_mN < 25.0
    assert held_mN(rig) == force_mN
    assert abs(held_mN(demo_rig(time="lockstep")) - force_mN) > 0.05
