"""Two rigs under a supervisor with keys and TLS: each SiLA server moves only its own rig."""

import asyncio
from collections.abc import Generator

import pytest

from contrib.support.sila import ended, refusal, responses, stock_client_at, unitelabs
from pincette.config import RigFile
from tests.support.adapters import FORCE_MN, SecuredLaboratory, secured_laboratory, until


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Generator[SecuredLaboratory]:
    with secured_laboratory(tmp_path_factory.mktemp("laboratory")) as made:
        yield made


async def held_by_unitelabs(rig: RigFile) -> tuple[str, str, str]:
    """Rig with which the second client grips, and the result."""
    async with unitelabs(rig) as client:
        gripper = client.Microgripper
        held = await ended(await gripper.Grip(Force=FORCE_MN, HoldTime=0.0, Recipe=""))
        free = await ended(await gripper.Release())
        return await gripper.Rig.read(), held.Outcome, free.Outcome


@pytest.mark.parametrize("scope", ["observe", "operate"])
def test_a_server_serves_one_rig_with_the_permissions_of_its_key(
    lab: SecuredLaboratory, scope: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet, right = lab.rigs.fleet, lab.rigs.right
    assert fleet is not None
    monkeypatch.setenv("PINCETTE_KEY", lab.keys[scope])
    fleet.start(["sila"])
    try:
        with stock_client_at(right) as client:
            gripper = client.Microgripper
            until(lambda: gripper.RigState.get() != "unknown", "it does not answer")
            assert gripper.Rig.get() == "right"
            grip = gripper.Grip(FORCE_MN, 0.0, "")
            if scope == "observe":
                assert refusal(grip).identifier == "NotPermitted"
                return
            assert responses(grip).Outcome == "held"
            assert lab.holds("right")
            assert lab.view("left")["active_job"] is None
            assert responses(gripper.Release()).Outcome == "released"
        assert asyncio.run(held_by_unitelabs(right)) == ("right", "held", "released")
        assert lab.view("left")["active_job"] is None
    finally:
        process = fleet.members["sila"].process
        process.terminate()
        process.wait(20.0)
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()
