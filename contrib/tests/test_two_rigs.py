"""Two rigs under a supervisor with keys and TLS: each adapter moves only its own rig."""

import asyncio
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from ophyd_async.core import NotConnectedError

from contrib.support.agent import agent, planned, refused, said
from contrib.support.npm import DRIVE, NODE_WOT, node, npm_folder
from contrib.support.run_engine import bps, closed, connected, ended, failure, new_engine
from contrib.support.viewer import viewing
from pincette.client import NotPermittedError
from pincette_bluesky import Gripper
from tests.support.adapters import (
    FORCE_MN,
    NEAR_MN,
    SecuredLaboratory,
    secured_laboratory,
    until,
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Generator[SecuredLaboratory]:
    with secured_laboratory(tmp_path_factory.mktemp("laboratory")) as found:
        yield found


@pytest.fixture
def lab(made: SecuredLaboratory) -> SecuredLaboratory:
    made.ready()
    return made


def right_holds_alone(lab: SecuredLaboratory) -> None:
    assert lab.holds("right")
    assert lab.view("left")["active_job"] is None


def right_is_latched_alone(lab: SecuredLaboratory) -> None:
    until(lambda: lab.latched("right"), "it is not latched")
    assert not lab.latched("left")


def test_an_agent_moves_only_the_rig_that_its_server_names(lab: SecuredLaboratory) -> None:
    trusting = ("--authority", str(lab.authority), "--move")
    right = (*trusting, "--rig", "right")

    async def drive() -> None:
        async with agent(lab.url, *right, key=lab.keys["operate"]) as client:
            held = await said(client, "grip", token=await planned(client))
            assert abs(held["force_held_mN"] - FORCE_MN) < NEAR_MN
            assert (await said(client, "status"))["rig"] == "right"
            await asyncio.to_thread(right_holds_alone, lab)
            assert (await said(client, "release"))["part"] == "none"
        async with agent(lab.url, *trusting, key=lab.keys["operate"]) as client:
            words = await refused(client, "status")
            assert "left, right" in words
        async with agent(lab.url, *right, key=lab.keys["observe"]) as client:
            words = await refused(client, "plan_grip", force_mN=FORCE_MN)
            assert "scope-too-small" in words
        async with agent(lab.url, *right) as client:
            assert "no-key" in await refused(client, "status")
            assert (await said(client, "emergency_stop"))["detail"] == "latched: estop"
        async with agent(lab.url, "--rig", "right", key=lab.keys["operate"]) as client:
            seen = await said(client, "status")
            assert seen["state"] == "unknown"
            assert "certificate" in seen["reasons"][0]
            assert "certificate" in await refused(client, "plan_grip", force_mN=FORCE_MN)

    asyncio.run(drive())
    right_is_latched_alone(lab)


@pytest.fixture
def engine() -> Generator[Any]:
    engine = new_engine()
    yield engine
    ended(engine)


def test_a_bluesky_device_moves_only_the_rig_that_it_names(
    lab: SecuredLaboratory, engine: Any
) -> None:
    def device(key: str) -> Gripper:
        return connected(lab.url, "right", key=lab.keys[key], authority=lab.authority)

    gripper = device("operate")
    engine(bps.mv(gripper, FORCE_MN))
    right_holds_alone(lab)
    engine(bps.mv(gripper, 0.0))
    seeing = device("observe")
    assert isinstance(failure(engine, bps.mv(seeing, FORCE_MN)), NotPermittedError)
    unnamed = Gripper(lab.url, key=lab.keys["operate"], authority=lab.authority, name="gripper")
    reached = asyncio.run_coroutine_threadsafe(unnamed.reach(10.0), engine.loop)
    with pytest.raises(NotConnectedError, match="left, right"):
        reached.result(20.0)
    for one in (gripper, seeing, unnamed):
        closed(engine, one)


def test_a_viewer_receives_only_messages_of_the_rig_of_its_server(lab: SecuredLaboratory) -> None:
    assert lab.rigs.fleet is not None
    lab.rigs.fleet.start(["foxglove"])
    with viewing(lab.rigs.right) as viewer:
        assert viewer.server["name"] == "pincette right"
        viewer.subscribe("estimate", "telemetry")
        job = lab.rigs.grip("left", until_released=True, force_mN=FORCE_MN)
        lab.rigs.left.until_phase(job, "hold")
        assert not any(viewer.seen.values())
        job = lab.rigs.grip("right", until_released=True, force_mN=FORCE_MN)
        lab.rigs.left.until_phase(job, "approach")
        viewer.until(lambda: len(viewer.seen.get("estimate", [])) > 5, "nothing is seen")
        viewer.call("estop")
        viewer.until(lambda: viewer.answers, "no answer")
    assert viewer.answers[0]["stopped"] is True, viewer.answers
    right_is_latched_alone(lab)
    assert lab.holds("left")


def test_a_thing_description_moves_only_the_rig_that_it_describes(
    lab: SecuredLaboratory, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder: Path = npm_folder(tmp_path_factory.mktemp("node"), DRIVE, *NODE_WOT)
    url = f"{lab.url}/.well-known/wot?rig=right"
    trusted = str(lab.authority)
    found = node(
        folder,
        DRIVE.name,
        url,
        str(FORCE_MN),
        lab.keys["operate"],
        NODE_EXTRA_CA_CERTS=trusted,
    )
    assert found["title"] == "pincette right"
    assert abs(found["held_mN"] - FORCE_MN) < NEAR_MN
    assert (found["state"], found["latch"]) == ("succeeded", "latched")
    right_is_latched_alone(lab)
