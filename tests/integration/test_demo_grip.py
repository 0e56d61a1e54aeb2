"""The demo grip in one process: what is true of the force, and what is stated of it."""

from math import fsum
from pathlib import Path

import pytest

from pincette.config import RigFile, read_rig
from pincette.core.messages import Estimate, GroundTruth, Message, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job

DEMO = Path(__file__).parents[2] / "deploy/rigs/demo.toml"


def demo_rig() -> RigFile:
    rig = read_rig(DEMO)
    return rig.model_copy(update={"rig": rig.rig.model_copy(update={"time": "lockstep"})})


@pytest.fixture(scope="module")
def published() -> list[Message]:
    rig = demo_rig()
    return ComposedLoop(rig).play(plan_job(GripJobRequest(kind="grip"), rig).program)


def in_phase(published: list[Message], *phases: str) -> list[int]:
    """Samples of some phases."""
    return [
        message.seq
        for message in published
        if isinstance(message, Telemetry) and message.phase in phases
    ]


def test_the_bead_is_gripped_with_the_force_that_is_stated(published: list[Message]) -> None:
    estimates = {message.seq: message for message in published if isinstance(message, Estimate)}
    truths = {
        message.seq: message.arms[0].force_mN
        for message in published
        if isinstance(message, GroundTruth)
    }
    telemetry = [message for message in published if isinstance(message, Telemetry)]
    assert telemetry[-1].outcome == "gripped"
    hold = in_phase(published, "hold")
    true_mN = [truths[seq] for seq in hold]
    mean_mN = fsum(true_mN) / len(true_mN)
    stated_mN = max(estimates[seq].arms[0].force_uncertainty_mN for seq in hold)
    assert abs(mean_mN - 20.0) < min(1.0, stated_mN)
    within = [
        abs(estimates[seq].arms[0].force_mN - truths[seq])
        <= estimates[seq].arms[0].force_uncertainty_mN
        for seq in hold
    ]
    assert within.count(True) >= 0.95 * len(within)


def test_contact_is_believed_only_where_there_is_one(published: list[Message]) -> None:
    truths = {
        message.seq: message.arms[0].force_mN
        for message in published
        if isinstance(message, GroundTruth)
    }
    assert truths[in_phase(published, "load")[0]] > 0.0


def test_the_contact_is_measured(published: list[Message]) -> None:
    rig = demo_rig()
    assert rig.simulation is not None
    last = [message for message in published if isinstance(message, Telemetry)][-1]
    assert last.contact_stiffness_mN_per_um == pytest.approx(
        rig.simulation.environment_stiffness_mN_per_um, rel=0.1
    )
    assert last.contact_x_um == pytest.approx(rig.simulation.bead_contact_um, abs=0.8)
