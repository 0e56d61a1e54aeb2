"""A rig of two arms with clients that request only a force: both arms close."""

import asyncio
from collections.abc import Generator
from typing import Any

import pytest

from contrib.support.agent import agent, planned, said
from contrib.support.run_engine import (
    bpp,
    bps,
    closed,
    connected,
    ended,
    new_engine,
    of,
    subscribed,
)
from pincette.api.pairs import PairPlan
from pincette.client import ProblemError, Supervisor
from tests.support.adapters import FORCE_MN, NEAR_MN, until
from tests.support.rigs import at_own_ports
from tests.support.running import RunningRig, running_rig
from tests.support.two_arms import SHORT_PAIR, two_arm_rig


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    with running_rig(
        at_own_ports(two_arm_rig(SHORT_PAIR)), tmp_path_factory.mktemp("rig")
    ) as running:
        yield running


def kinds_of(rig: RunningRig) -> list[str]:
    return [job["kind"] for job in rig.get("/jobs")["jobs"]]


def test_a_grip_without_options_uses_both_arms(rig: RunningRig) -> None:
    with Supervisor(rig.rig.supervisor.url) as supervisor:
        handle = supervisor.rig()
        plan = handle.plan("grip", force_mN=FORCE_MN)
        assert isinstance(plan, PairPlan)
        job = handle.start("grip", force_mN=FORCE_MN, idempotency_key="one")
        again = handle.start("grip", force_mN=FORCE_MN, idempotency_key="one")
        assert (job.id, job.job.kind) == (again.id, "grip")
        assert rig.ended(job.id)["state"] == "succeeded"
        with pytest.raises(ProblemError, match="profile is for 1 driven arm, and this rig has 2"):
            handle.plan("grip", profile="quick")
        with pytest.raises(ProblemError, match="a track with two arms needs a path"):
            handle.plan("track")


def test_a_recipe_supplies_the_missing_values_of_a_grip(rig: RunningRig) -> None:
    saved = rig.post("/recipes", {"name": "bead", "values": {"force_mN": 7.0, "hold_s": 0.3}})
    assert saved.status_code == 201, saved.text
    job = rig.post("/jobs", {"kind": "grip", "recipe": "bead", "dry_run": True})
    assert job.status_code == 200, job.text
    assert job.json()["prediction"]["figures"]["force_held_mN"] == pytest.approx(7.0, abs=0.2)


def test_a_run_engine_sets_a_force_and_releases(rig: RunningRig) -> None:
    engine: Any = new_engine()
    seen: list[tuple[str, Any]] = []
    subscribed(engine, seen)
    gripper = connected(rig.rig.supervisor.url)

    @bpp.run_decorator()
    def read() -> Generator[Any, Any, None]:
        yield from bps.trigger_and_read([gripper])

    try:
        engine(bps.abs_set(gripper, FORCE_MN, wait=True))
        assert rig.view()["part"] == "held"
        engine(read())
        (held,) = (event["data"] for event in of(seen, "event"))
        assert held["gripper-force_mN"] == pytest.approx(FORCE_MN, abs=NEAR_MN)
        assert held["gripper-second_force_mN"] == pytest.approx(FORCE_MN, abs=NEAR_MN)
        engine(bps.abs_set(gripper, 0.0, wait=True))
        until(lambda: rig.view()["active_job"] is None, "a job is left")
        assert kinds_of(rig)[0] == "grip"
    finally:
        closed(engine, gripper)
        ended(engine)


def test_a_flight_collects_the_samples_of_both_arms(rig: RunningRig) -> None:
    engine: Any = new_engine()
    seen: list[tuple[str, Any]] = []
    subscribed(engine, seen)
    gripper = connected(rig.rig.supervisor.url)

    @bpp.run_decorator()
    def fly() -> Generator[Any, Any, None]:
        yield from bps.prepare(gripper, {"kind": "grip", "force_mN": FORCE_MN}, wait=True)
        yield from bps.declare_stream(gripper, name="samples", collect=True)
        yield from bps.kickoff(gripper, wait=True)
        yield from bps.complete(gripper, wait=True)
        yield from bps.collect(gripper, name="samples")

    try:
        engine(fly())
        (page,) = of(seen, "event_page")
        data = page["data"]
        last = max(place for place, one in enumerate(data["gripper-phase"]) if one == "hold")
        assert data["gripper-second_force_mN"][last] == pytest.approx(FORCE_MN, abs=NEAR_MN)
        apart_um = data["gripper-x_um"][last] - data["gripper-second_x_um"][last]
        assert data["gripper-place_um"][last] == pytest.approx(0.5 * apart_um, abs=0.1)
    finally:
        closed(engine, gripper)
        ended(engine)


def test_an_agent_grips_and_releases(rig: RunningRig) -> None:
    async def drive() -> None:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            held = await said(client, "grip", token=await planned(client))
            assert held["outcome"] == "held"
            assert abs(held["force_held_mN"] - FORCE_MN) < NEAR_MN
            assert (await said(client, "release"))["part"] == "none"

    asyncio.run(drive())
