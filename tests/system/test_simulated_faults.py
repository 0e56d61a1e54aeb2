"""Faults of a simulated rig by REST: the stock client sends them, and the real loop meets them."""

from collections.abc import Generator

import pytest

from pincette.client import InvalidRequestError, ProblemError, RigHandle, Supervisor
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


def test_a_sensor_that_falls_silent_trips_the_job_and_heals(
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


def test_all_that_there_is_is_listed_with_units_and_bounds(rig: RunningRig) -> None:
    found = rig.get(f"/rigs/{rig.rig.rig.name}/simulation/commands")["operations"]
    hang = next(one for one in found if (one["target"], one["what"]) == ("weight", "hang"))
    assert (hang["least"], hang["most"], hang["lasts"]) == (-1000.0, 1000.0, False)
    assert hang["quantity"].startswith("mN")


def test_what_cannot_be_done_says_why(handle: RigHandle) -> None:
    with pytest.raises(InvalidRequestError) as unknown:
        handle.simulate("sensor", "explode")
    assert unknown.value.code == "simulation-impossible"
    with pytest.raises(InvalidRequestError) as beyond:
        handle.simulate("sensor", "slow", value=9.0)
    problem = beyond.value.problem
    assert (problem["value"], problem["most"], problem["quantity"]) == (9.0, 5.0, "s")
    assert problem["remedy"]


def test_a_rig_that_is_not_to_be_scripted_refuses(paced: RunningRig) -> None:
    with Supervisor(paced.rig.supervisor.url) as supervisor, pytest.raises(ProblemError) as refused:
        supervisor.rig().simulate("part", "remove")
    assert (refused.value.status, refused.value.code) == (409, "simulation-refused")
