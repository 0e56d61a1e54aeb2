"""The demo grip with the voltage output exchanged: the rest of the loop knows nothing of it."""

from math import fsum

import pytest

from pincette.config import Output, RigFile
from pincette.core.messages import Applied, GroundTruth, Message, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.rigs import demo_rig, output_step_V


def truths(published: list[Message]) -> list[GroundTruth]:
    return [message for message in published if isinstance(message, GroundTruth)]


@pytest.fixture(scope="module")
def rig() -> RigFile:
    return demo_rig(time="lockstep")


@pytest.fixture(scope="module")
def published(rig: RigFile) -> list[Message]:
    output = Output(driver="srs_dc205", url=rig.output.url)
    own = rig.model_copy(update={"output": output})
    return ComposedLoop(own).play(plan_job(GripJobRequest(kind="grip"), own).program)


def test_the_bead_is_gripped(published: list[Message]) -> None:
    telemetry = [message for message in published if isinstance(message, Telemetry)]
    assert telemetry[-1].outcome == "gripped"
    hold = {message.seq for message in telemetry if message.phase == "hold"}
    true_mN = [truth.arms[0].force_mN for truth in truths(published) if truth.seq in hold]
    assert len(true_mN) >= 100
    assert fsum(true_mN) / len(true_mN) == pytest.approx(20.0, abs=1.0)


def test_each_voltage_arrives_in_its_tick(rig: RigFile, published: list[Message]) -> None:
    """To half a step of the simulated rig; the line's own is a thousand times finer."""
    arrived_V = {truth.seq: truth.arms[0].voltage_V for truth in truths(published)}
    wanted_V = {
        message.seq: message.arms[0].voltage_V
        for message in published
        if isinstance(message, Applied) and message.answered
    }
    ticks = sorted(wanted_V.keys() & arrived_V.keys())
    assert ticks == list(range(len(arrived_V)))
    apart_V = [abs(wanted_V[tick] - arrived_V[tick]) for tick in ticks]
    assert max(apart_V) <= 0.501 * output_step_V(rig)
    assert max(wanted_V.values()) > 1.0
