"""Independent testers and bridges for SiLA 2 servers, in separate environments."""

import asyncio
from pathlib import Path
from typing import Any

import pytest
from mcp import Client, StdioServerParameters

from tests.support.adapters import FORCE_MN, NEAR_MN
from tests.support.environments import environment, ran
from tests.support.grips import make_ready
from tests.support.running import RunningRig

pytestmark = pytest.mark.slow

TESTER = "sila2_interop_communication_tester.test_client"
LONG_S = 120.0


@pytest.fixture
def address(rig: RunningRig) -> str:
    make_ready(rig)
    return f"{rig.rig.sila.host}:{rig.rig.sila.port}"


def test_the_interoperability_tester_passes(address: str, tmp_path: Path) -> None:
    python = environment(tmp_path / "venv", "sila2-interop-communication-tester==0.10.3")
    # Its tests of other features need a server made for them.
    line = [str(python), "-m", TESTER, "--server-address", address, "sila_service"]
    output = ran(line, tmp_path)
    assert " passed" in output
    assert " failed" not in output
    assert " error" not in output


def test_an_mcp_agent_can_grip_through_the_sila_bridge(
    rig: RunningRig, address: str, tmp_path: Path
) -> None:
    """The bridge uses only the feature definition that the server sends."""
    python = environment(tmp_path / "venv", "labmcp-sila2==0.1.2")
    script = str(python.with_name("labmcp-sila2"))
    options = ["--address", address, "--option", "insecure=true"]
    bridge = StdioServerParameters(command=script, args=options)

    async def call(client: Client, command: str, **parameters: Any) -> dict[str, Any]:
        wanted = {"feature": "Microgripper", "command": command, "parameters": parameters}
        answer = await client.call_tool("call_command", {**wanted, "wait_s": 60.0})
        assert not answer.is_error, answer.content
        assert answer.structured_content is not None
        return answer.structured_content

    async def drive() -> None:
        async with asyncio.timeout(LONG_S), Client(bridge) as client:
            plan = await call(client, "Plan", Force=500.0, HoldTime=0.0, Recipe="")
            assert plan["responses"]["Feasible"] is False
            assert "above the limit 40 mN" in plan["responses"]["Violations"][0]
            refused = await call(client, "Grip", Force=500.0, HoldTime=0.0, Recipe="")
            assert "LimitViolation" in str(refused["error"])
            held = await call(client, "Grip", Force=FORCE_MN, HoldTime=0.0, Recipe="")
            assert abs(held["responses"]["HeldForce"] - FORCE_MN) < NEAR_MN
            assert rig.view()["part"] == "held"
            released = await call(client, "Release")
            assert released["responses"]["Outcome"] == "released"

    asyncio.run(drive())
