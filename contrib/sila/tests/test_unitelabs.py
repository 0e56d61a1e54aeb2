"""The unitelabs client, which loads the features from the server, also drives a rig."""

import asyncio
import signal
from typing import Any

import pytest
from sila.framework import DefinedExecutionError, InvalidMetadata

from contrib.support.sila import ended, unitelabs
from tests.support.adapters import FORCE_MN, NEAR_MN, WAIT_S, until
from tests.support.grips import restart
from tests.support.running import RunningRig

pytestmark = pytest.mark.usefixtures("cleared")


async def refused(command: Any) -> DefinedExecutionError:
    """The error that ends a command, immediately or later."""
    with pytest.raises(DefinedExecutionError) as caught:
        await ended(await command)
    return caught.value


def test_a_grip_samples_and_a_release_work(rig: RunningRig) -> None:
    async def grip() -> tuple[Any, list[str], list[float], Any]:
        async with unitelabs(rig.rig) as client:
            gripper = client.Microgripper
            execution = await gripper.Grip(Force=FORCE_MN, HoldTime=0.0, Recipe="")
            samples = await execution.subscribe_intermediate_responses()
            reported = await execution.subscribe_status()
            progress = [
                float(one.progress.value) async for one in reported if one.progress is not None
            ]
            phases = [one.Sample.Phase async for one in samples]
            return await execution.get_responses(), phases, progress, await released(gripper)

    async def released(gripper: Any) -> Any:
        return await ended(await gripper.Release())

    held, phases, progress, free = asyncio.run(grip())
    assert held.Outcome == "held"
    assert abs(held.HeldForce - FORCE_MN) < NEAR_MN
    assert "load" in phases
    assert progress == sorted(progress)
    assert free.Outcome == "released"


def test_requests_that_break_a_limit_are_refused_with_value_unit_and_limit(rig: RunningRig) -> None:
    async def grip() -> DefinedExecutionError:
        async with unitelabs(rig.rig) as client:
            return await refused(client.Microgripper.Grip(Force=500.0, HoldTime=0.0, Recipe=""))

    error = asyncio.run(grip())
    assert error.fully_qualified_identifier.endswith("/LimitViolation")
    assert "force 500.000 mN above the limit 40 mN" in error.message
    assert rig.view()["active_job"] is None


def test_a_cancel_during_the_request_stops_it(rig: RunningRig) -> None:
    async def grip() -> tuple[str, DefinedExecutionError]:
        async with unitelabs(rig.rig) as client:
            rig.fleet.signal("supervisor", signal.SIGSTOP)
            try:
                execution = await client.Microgripper.Grip(Force=FORCE_MN, HoldTime=0.0, Recipe="")
                uuid = execution.command_execution_uuid
                await asyncio.sleep(0.3)
                # The request and the cancel both wait at its port when the process continues.
                cancel = client.CancelController.CancelCommand(CommandExecutionUUID=uuid)
                cancelled = asyncio.ensure_future(cancel)
                await asyncio.sleep(0.3)
            finally:
                rig.fleet.signal("supervisor", signal.SIGCONT)
            await cancelled
            with pytest.raises(DefinedExecutionError) as caught:
                await ended(execution)
            return uuid, caught.value

    uuid, error = asyncio.run(grip())
    assert error.fully_qualified_identifier.endswith("/Cancelled")
    jobs = rig.get("/jobs", label=f"sila=Grip {uuid}")["jobs"]
    assert {job["state"] for job in jobs} <= {"stopped"}


def test_a_lock_prevents_grips_but_not_an_emergency_stop_which_is_reported(rig: RunningRig) -> None:
    async def drive() -> tuple[DefinedExecutionError, Any, DefinedExecutionError]:
        async with unitelabs(rig.rig) as client:
            gripper, locks = client.Microgripper, client.LockController
            await locks.LockServer(LockIdentifier="cell 7", Timeout=60)
            wanted: dict[str, Any] = {"Force": FORCE_MN, "HoldTime": 0.0, "Recipe": ""}
            with pytest.raises(InvalidMetadata):
                await ended(await gripper.Grip(**wanted))
            key = await locks.LockIdentifier.from_native(client, "cell 7")
            grip = await gripper.Grip(**wanted, metadata=[key])
            await asyncio.to_thread(until, lambda: rig.view()["active_job"], "no job")
            stopped = await gripper.EmergencyStop()
            with pytest.raises(DefinedExecutionError) as caught:
                await ended(grip)
            await locks.UnlockServer(LockIdentifier="cell 7")
            while await gripper.RigState.read() != "latched":
                await asyncio.sleep(0.05)
            return caught.value, stopped, await refused(gripper.Grip(**wanted))

    ends, stopped, again = asyncio.run(drive())
    assert stopped.Cause == "estop"
    assert ends.fully_qualified_identifier.endswith("/RigLatched")
    assert "estop" in ends.message
    assert again.fully_qualified_identifier.endswith("/RigLatched")


def test_a_new_connection_finds_a_held_part(rig: RunningRig) -> None:
    """The part stays held after a client has disconnected; the next client finds and releases
    it."""

    async def grip() -> str:
        async with unitelabs(rig.rig) as client:
            held = await ended(
                await client.Microgripper.Grip(Force=FORCE_MN, HoldTime=0.0, Recipe="")
            )
            return held.Job

    async def release() -> tuple[str, str]:
        async with unitelabs(rig.rig) as client:
            part = await client.Microgripper.Part.read()
            return part, (await ended(await client.Microgripper.Release())).Job

    job = asyncio.run(grip())
    assert asyncio.run(release()) == ("held", job)


def test_a_killed_server_and_a_killed_supervisor_are_reported_and_the_part_stays_held(
    rig: RunningRig,
) -> None:
    async def grip() -> str:
        async with unitelabs(rig.rig) as client:
            grip = await client.Microgripper.Grip(Force=FORCE_MN, HoldTime=0.0, Recipe="")
            return (await ended(grip)).Job

    async def until_read(one: Any, wanted: str) -> None:
        async with asyncio.timeout(WAIT_S):
            while await one.read() != wanted:
                await asyncio.sleep(0.05)

    async def drive() -> tuple[DefinedExecutionError, Any]:
        async with unitelabs(rig.rig) as client:
            gripper = client.Microgripper
            await until_read(gripper.Part, "held")
            rig.fleet.signal("supervisor", signal.SIGKILL)
            await until_read(gripper.RigState, "unknown")
            assert "no answer" in (await gripper.Reasons.read())[0]
            gone = await refused(gripper.Release())
            await asyncio.to_thread(restart, rig, "supervisor")
            # The same connection is used again: the server has not been restarted.
            await until_read(gripper.Part, "held")
            return gone, await ended(await gripper.Release())

    job = asyncio.run(grip())
    rig.fleet.signal("sila", signal.SIGKILL)
    assert rig.view()["part"] == "held"
    assert rig.view()["active_job"] == job
    restart(rig, "sila")
    gone, released = asyncio.run(drive())
    assert gone.fully_qualified_identifier.endswith("/SupervisorUnreachable")
    assert released.Outcome == "released"
    assert rig.view()["part"] == "none"
