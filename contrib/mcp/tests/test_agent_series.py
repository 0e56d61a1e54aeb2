"""An agent decides about grips that failed, and runs a series, by the stock client over stdio."""

import asyncio
from collections.abc import Generator
from typing import Any

import pytest
from mcp import Client

from contrib.support.agent import agent, planned, refused, said
from tests.support.adapters import FORCE_MN, WAIT_S
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig

TRACE = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    """The demo rig in lockstep: repeated grips there end with a zero that verifies their force."""
    demo = demo_rig({"simulation": {"scripts": True}}, time="lockstep")
    with running_rig(demo, tmp_path_factory.mktemp("rig")) as up:
        yield up


def part(rig: RunningRig, what: str) -> None:
    body = {"target": "part", "what": what}
    rig.post("/rigs/demo/simulation/commands", body).raise_for_status()


def test_an_agent_decides_about_a_grip_that_met_no_part(rig: RunningRig) -> None:
    async def missed(client: Client) -> str:
        token = await planned(client, hold_s=0.4)
        words = await refused(client, "grip", token=token, recovery_s=600.0)
        assert "awaiting-recovery (no_contact): " in words
        status = await said(client, "status")
        assert (status["job_state"], status["recovery"]["case"]) == (
            "awaiting_recovery",
            "no_contact",
        )
        assert "accept" not in status["recovery"]["decisions"]
        return status["job"]

    async def drive() -> str:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            job = await missed(client)
            assert "invalid-transition" in await refused(
                client, "decide", job=job, decision="accept"
            )
            given_up = await said(client, "decide", job=job, decision="give_up")
            assert (given_up["job"], given_up["detail"]) == (job, "failed")
            job = await missed(client)
            await asyncio.to_thread(part, rig, "place")
            again = await said(client, "decide", job=job, decision="retry")
            assert again["job"] != job
            ended = await asyncio.to_thread(rig.ended, again["job"], WAIT_S)
            status = await said(client, "status", job=again["job"])
            assert (status["job"], status["job_state"]) == (again["job"], "succeeded")
            assert (status["outcome"], status["cause"]) == ("gripped", "")
            assert status["force_held_mN"] == ended["result"]["force_held_mN"]
            failed = await said(client, "status", job=job)
            assert (failed["job_state"], failed["outcome"]) == (again["detail"], "no_contact")
            assert failed["force_held_mN"] is None
            assert "not-found" in await refused(client, "status", job="no-such-job")
            return again["job"]

    part(rig, "remove")
    try:
        assert rig.ended(asyncio.run(drive()), WAIT_S)["state"] == "succeeded"
    finally:
        part(rig, "place")


def test_an_agent_runs_a_series_with_a_missing_part_in_the_trace_of_its_call(
    rig: RunningRig,
) -> None:
    asked = {"forces_mN": [FORCE_MN, FORCE_MN + 1.0], "hold_s": 0.4, "recovery_s": 600.0}

    async def until_it_rests(client: Client, series: str) -> dict[str, Any]:
        while True:
            now = await said(client, "series", series=series, wait_s=60.0)
            if now["state"] != "running" or now["recovery"] is not None:
                return now

    async def drive() -> str:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            plan = await said(client, "plan_series", **asked)
            assert plan["total"] == 2
            assert "no-plan" in await refused(client, "grip", token=plan["token"])
            given = {"token": (await said(client, "plan_series", **asked))["token"]}
            answer = await client.call_tool("run_series", given, meta={"traceparent": TRACE})
            assert answer.structured_content is not None, answer.content
            series = answer.structured_content["series"]
            assert "no-plan" in await refused(client, "run_series", **given)
            waits = await until_it_rests(client, series)
            assert waits["recovery"]["case"] == "no_contact"
            await asyncio.to_thread(part, rig, "place")
            await said(client, "decide", job=waits["job"], decision="retry")
            ended = await until_it_rests(client, series)
            assert (ended["state"], ended["ended"], ended["failed"]) == ("completed", 2, 0)
            return series

    part(rig, "remove")
    try:
        series = asyncio.run(drive())
    finally:
        part(rig, "place")
    jobs = rig.get("/jobs", label=f"series={series}")["jobs"]
    assert [job["traceparent"] for job in jobs] == [TRACE] * 3


def test_a_stop_ends_a_series_between_two_grips_too(rig: RunningRig) -> None:
    async def drive() -> dict[str, Any]:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            asked = {"forces_mN": [FORCE_MN] * 3, "hold_s": 0.4, "pause_s": 3600.0}
            plan = await said(client, "plan_series", **asked)
            series = (await said(client, "run_series", token=plan["token"]))["series"]
            while (await said(client, "series", series=series))["ended"] == 0:
                await asyncio.sleep(0.1)
            await said(client, "stop")
            return await said(client, "series", series=series)

    found = asyncio.run(drive())
    assert (found["state"], found["ended"]) == ("stopped", 1)
