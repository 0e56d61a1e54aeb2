"""The stock client of the Model Context Protocol drives a rig over stdio, in lockstep."""

import asyncio
import json
import os
import signal
import sys
from base64 import urlsafe_b64decode
from pathlib import Path
from typing import Any

import pytest
from mcp import Client, MCPError, StdioServerParameters

from contrib.support.agent import agent, planned, refused, said
from tests.support.adapters import FORCE_MN, NEAR_MN, WAIT_S
from tests.support.grips import restart
from tests.support.running import Json, RunningRig

LOOKS = {"status", "plan_grip", "plan_series", "series"}
STOPS, MOVES = {"stop", "emergency_stop"}, {"grip", "release", "decide", "run_series"}


async def until_phase(rig: RunningRig, phase: str) -> str:
    """The job that has come to a phase."""
    while True:
        view = await asyncio.to_thread(rig.view)
        newest: Json = view["newest"] or {}
        if view["active_job"] is not None and newest.get("phase") == phase:
            return view["active_job"]
        await asyncio.sleep(0.02)


def test_tools_that_move_the_arm_are_offered_only_if_enabled(rig: RunningRig) -> None:
    async def listed(*options: str) -> dict[str, Any]:
        async with agent(rig.rig.supervisor.url, *options) as client:
            return {tool.name: tool for tool in (await client.list_tools()).tools}

    looking, moving = asyncio.run(listed()), asyncio.run(listed("--move"))
    assert set(looking) == LOOKS | STOPS
    assert set(moving) == LOOKS | STOPS | MOVES
    assert {name for name, tool in moving.items() if tool.annotations.read_only_hint} == LOOKS
    assert {name for name, tool in moving.items() if tool.annotations.destructive_hint} == MOVES


def test_a_grip_uses_the_token_of_a_plan_once(rig: RunningRig) -> None:
    received: list[tuple[float, float | None, str | None]] = []

    async def tell(progress: float, total: float | None, message: str | None) -> None:
        received.append((progress, total, message))

    async def drive() -> None:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            assert (await said(client, "status"))["part"] != "held"
            token = await planned(client)
            answer = await client.call_tool("grip", {"token": token}, progress_callback=tell)
            held = answer.structured_content
            assert held is not None
            assert held["outcome"] == "held"
            assert abs(held["force_held_mN"] - FORCE_MN) < NEAR_MN
            status = await said(client, "status")
            assert (status["part"], status["job"]) == ("held", held["job"])
            assert "no-plan" in await refused(client, "grip", token=token)
            assert "no-plan" in await refused(client, "grip", token="made up")
            forged = f"{token[:-1]}{'A' if token[-1] != 'A' else 'B'}"
            assert "never issued" in await refused(client, "grip", token=forged)
            released = await said(client, "release")
            assert (released["job"], released["part"]) == (held["job"], "none")
            assert "nothing-held: " in await refused(client, "release")

    asyncio.run(drive())
    assert any("hold" in (words or "") for _, _, words in received)
    assert [now for now, _, _ in received] == sorted(now for now, _, _ in received)
    assert any(total is not None and now < total for now, total, _ in received)


def test_an_agent_proposes_a_grip_and_learns_what_a_person_has_decided(rig: RunningRig) -> None:
    async def drive() -> None:
        async with agent(rig.rig.supervisor.url, "--propose") as client:
            tools = {tool.name for tool in (await client.list_tools()).tools}
            assert tools == LOOKS | STOPS | {"propose_grip", "proposal"}
            token = await planned(client, hold_s=0.6)
            proposed = await said(client, "propose_grip", token=token)
            assert proposed["state"] == "proposed"
            job, body = proposed["job"], {"type": "approve"}
            answer = await asyncio.to_thread(rig.post, f"/jobs/{job}/actions", body)
            answer.raise_for_status()
            await asyncio.to_thread(rig.ended, job, WAIT_S)
            found = await said(client, "proposal", job=job)
            assert found["state"] == "succeeded", found["cause"]
            assert abs(found["force_held_mN"] - FORCE_MN) < NEAR_MN

    asyncio.run(drive())


def test_a_grip_with_a_hold_time_returns_when_its_job_ends(rig: RunningRig) -> None:
    async def drive() -> dict[str, Any]:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            return await said(client, "grip", token=await planned(client, hold_s=0.6))

    done = asyncio.run(drive())
    assert done["outcome"] == "gripped"
    assert abs(done["force_held_mN"] - FORCE_MN) < NEAR_MN


def test_a_stop_in_a_timed_hold_ends_the_call_with_the_part_held(rig: RunningRig) -> None:
    async def drive() -> None:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            token = await planned(client, hold_s=60.0)
            grip = asyncio.create_task(client.call_tool("grip", {"token": token}))
            await until_phase(rig, "hold")
            stopped = await said(client, "stop")
            assert (stopped["detail"], stopped["part"]) == ("stopped", "held")
            ended = await grip
            assert ended.is_error
            words = getattr(ended.content[0], "text", "")
            assert "cancelled (stopped): " in words
            assert "held" in words
            assert (await said(client, "status"))["ready"] is True
            assert (await said(client, "release"))["part"] == "none"
            done = await said(client, "grip", token=await planned(client, hold_s=0.4))  # at once
            assert done["outcome"] == "gripped"

    asyncio.run(drive())


def test_a_token_states_its_plan_and_can_be_used_once_even_after_a_restart_of_the_server(
    rig: RunningRig,
) -> None:
    async def drive() -> None:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            plan = await said(client, "plan_grip", force_mN=FORCE_MN)
        stated = {name: plan[name] for name in ("rig", "kind", "force_mN", "hold_s")}
        assert stated == {"rig": "demo", "kind": "grip", "force_mN": FORCE_MN, "hold_s": None}
        async with agent(rig.rig.supervisor.url, "--move") as client:
            held = await said(client, "grip", token=plan["token"])
            assert (await said(client, "plan_grip", force_mN=FORCE_MN - 2.0))["kind"] == "hold"
        async with agent(rig.rig.supervisor.url, "--move") as client:
            words = await refused(client, "grip", token=plan["token"])
            assert f"is used: job {held['job']} is running" in words
            await said(client, "release")

    asyncio.run(drive())


@pytest.mark.parametrize(
    "arguments",
    [
        {"force_mN": FORCE_MN, "hold": 2.0},
        {"force_mN": str(FORCE_MN)},
        {"force_mN": FORCE_MN, "hold_s": "null"},
        {"force_mN": FORCE_MN, "hold_s": "2.0"},
    ],
)
def test_unknown_arguments_and_text_in_place_of_numbers_are_refused(
    rig: RunningRig, arguments: dict[str, Any]
) -> None:
    async def drive() -> str:
        async with agent(rig.rig.supervisor.url) as client:
            for tool in (await client.list_tools()).tools:
                assert tool.input_schema["additionalProperties"] is False
            return await refused(client, "plan_grip", **arguments)

    assert any(name in asyncio.run(drive()) for name in ("hold", "force_mN"))


def test_a_plan_that_breaks_a_limit_has_no_token(rig: RunningRig) -> None:
    async def drive() -> tuple[dict[str, Any], str]:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            return await said(client, "plan_grip", force_mN=500.0), await refused(
                client, "plan_grip", force_mN=-1.0
            )

    plan, words = asyncio.run(drive())
    assert (plan["feasible"], plan["token"]) == (False, None)
    assert "force 500.000 mN above the limit 40 mN" in plan["violations"][0]
    assert "greater than 0" in words


@pytest.mark.parametrize("how", ["stop", "cancel", "timeout"])
def test_a_grip_that_is_stopped_or_cancelled_during_its_motion_comes_to_rest(
    rig: RunningRig, how: str
) -> None:
    timeout_s = 1.0 if how == "timeout" else None

    async def drive() -> str:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            given = {"token": await planned(client)}
            call = client.call_tool("grip", given, read_timeout_seconds=timeout_s)
            grip = asyncio.create_task(call)
            job = await until_phase(rig, "approach")
            if how == "stop":
                await said(client, "stop")
                assert (await grip).is_error
                return job
            if how == "cancel":
                grip.cancel()
            with pytest.raises((asyncio.CancelledError, MCPError)):
                await grip
            return job

    assert rig.ended(asyncio.run(drive()))["state"] == "stopped"
    assert rig.view()["part"] == "none"


def test_a_stop_during_the_request_leaves_no_job(rig: RunningRig) -> None:
    async def drive() -> str:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            token = await planned(client)
            rig.fleet.signal("supervisor", signal.SIGSTOP)
            try:
                grip = asyncio.create_task(client.call_tool("grip", {"token": token}))
                await asyncio.sleep(0.3)
                stop = asyncio.create_task(client.call_tool("stop", {}))
                await asyncio.sleep(0.3)
            finally:
                rig.fleet.signal("supervisor", signal.SIGCONT)
            assert not (await stop).is_error
            assert (await grip).is_error
            return token

    plan = json.loads(urlsafe_b64decode(asyncio.run(drive()).partition(".")[0]))
    assert {job["state"] for job in rig.get("/jobs", label=f"mcp={plan[0]}")["jobs"]} <= {"stopped"}


def test_an_emergency_stop_and_the_latch_are_reported(rig: RunningRig) -> None:
    async def drive() -> None:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            grip = asyncio.create_task(client.call_tool("grip", {"token": await planned(client)}))
            await until_phase(rig, "approach")
            assert (await said(client, "emergency_stop"))["detail"] == "latched: estop"
            ended = await grip
            assert ended.is_error
            assert "estop" in getattr(ended.content[0], "text", "")
            while (await said(client, "status"))["state"] != "latched":
                await asyncio.sleep(0.05)
            plan = await said(client, "plan_grip", force_mN=FORCE_MN)
            words = await refused(client, "grip", token=plan["token"] or "none")
            assert "rig-latched" in words or "estop-engaged" in words

    asyncio.run(drive())


def test_after_a_killed_server_the_part_stays_held_and_the_next_server_finds_its_job(
    rig: RunningRig, tmp_path: Path
) -> None:
    async def hold() -> str:
        # The shell names the process that the client has started.
        script = f'echo $$ > {tmp_path}/pid; exec "$@"'
        line = ["-c", script, "sh", sys.executable, "-m", "pincette_mcp", "--move"]
        server = StdioServerParameters(
            command="sh", args=[*line, "--url", rig.rig.supervisor.url], env={**os.environ}
        )
        async with asyncio.timeout(WAIT_S), Client(server) as client:
            held = await said(client, "grip", token=await planned(client))
            os.kill(int((tmp_path / "pid").read_text()), signal.SIGKILL)
            return held["job"]

    async def let_go() -> tuple[dict[str, Any], dict[str, Any]]:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            return await said(client, "status"), await said(client, "release")

    job = asyncio.run(hold())
    status, released = asyncio.run(let_go())
    assert (status["job"], status["part"]) == (job, "held")
    assert (released["job"], released["part"]) == (job, "none")


def test_an_unreachable_supervisor_is_reported_and_a_restarted_one_can_release(
    rig: RunningRig,
) -> None:
    async def drive() -> tuple[dict[str, Any], dict[str, Any]]:
        async with agent(rig.rig.supervisor.url, "--move") as client:
            await said(client, "grip", token=await planned(client))
            rig.fleet.signal("supervisor", signal.SIGKILL)
            gone = await said(client, "status")
            release = asyncio.create_task(said(client, "release"))  # it waits for the supervisor
            await asyncio.to_thread(restart, rig, "supervisor")
            return gone, await release

    gone, released = asyncio.run(drive())
    assert (gone["state"], gone["part"], gone["ready"]) == ("unknown", "unknown", False)
    assert "no answer" in gone["reasons"][0]
    assert released["part"] == "none"


def test_the_server_starts_without_its_supervisor_and_reports_it() -> None:
    async def drive() -> dict[str, Any]:
        async with agent("http://127.0.0.1:9") as client:
            return await said(client, "status")

    found = asyncio.run(drive())
    assert (found["state"], found["ready"]) == ("unknown", False)
    assert "127.0.0.1:9" in found["reasons"][0]
