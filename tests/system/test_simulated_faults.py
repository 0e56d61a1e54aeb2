"""Faults of a simulated rig by REST: the unmodified client requests them, and the real loop
reacts."""

from collections.abc import Generator

import pytest

from pincette.client import RigHandle, Supervisor
from pincette.config.reading import laid_over
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    scripted = demo_rig(laid_over(SHORT, {"simulation": {"scripts": True}}), time="lockstep")
    with running_rig(scripted, tmp_path_factory.mktemp("rig")) as running:
        yield running


@pytest.fixture
def handle(rig: RunningRig) -> Generator[RigHandle]:
    make_ready(rig)
    with Supervisor(rig.rig.supervisor.url) as supervisor:
        yield supervisor.rig()


def test_a_sensor_that_falls_silent_trips_the_job_and_recovers(
    rig: RunningRig, handle: RigHandle
) -> None:
    job = handle.start("grip", force_mN=8.0, until_released=True)
    rig.until_phase(job.id, "hold")
    sent = handle.simulate("sensor", "off")
    assert (sent.target, sent.what, sent.value) == ("sensor", "off", None)
    job.wait(60.0)
    assert job.state == "failed"
    assert job.job.ending is not None
    assert job.job.ending.code == "tripped"
    handle.simulate("sensor", "heal")
    make_ready(rig)
    again = handle.start("grip", force_mN=8.0)
    again.wait(60.0)
    assert again.state == "succeeded"
