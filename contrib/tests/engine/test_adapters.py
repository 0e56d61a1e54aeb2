"""With its profile the server of an adapter starts too, and the stock client on the host grips."""

import asyncio
import subprocess
from collections.abc import Generator

import pytest
from mcp import Client, StdioServerParameters

from contrib.support.stock_clients import block, grip_by_sila, on_the_host
from tests.support.checkout import ROOT, environment
from tests.support.contained import PROFILES
from tests.support.engine import Project, told
from tests.support.engine_contents import contents
from tests.support.engine_rig import adapted_rig, mounting
from tests.support.engine_stalls import ContainerStalls

NAME = "pincette-adapters"
LONG_S = 900.0


@pytest.fixture(scope="module", params=[(), ("secure",)], ids=["plain", "secure"])
def project(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Generator[Project]:
    """The whole rig with every profile, started by one command."""
    over = mounting(adapted_rig(), tmp_path_factory.mktemp("adapters"), "sila", "foxglove")
    one = Project(NAME, *request.param, over)
    one.down()
    wanted = [word for profile in PROFILES for word in ("--profile", profile)]
    try:
        line = f"docker compose {' '.join(wanted)} up -d --build --wait"
        done = one.shell(line, LONG_S)
        assert done.returncode == 0, f"{done.stdout[-3000:]}\n{one.said()}"
        yield one
    finally:
        Project(NAME, *request.param, over, COMPOSE_PROFILES=",".join([*PROFILES, "agents"])).down()


@pytest.fixture
def ready(project: Project, stalls: ContainerStalls) -> Project:  # noqa: ARG001  records stalls
    """Project whose rig is not latched and holds nothing, even if the previous test failed."""
    for line in (["reset"], ["job", "release"]):  # refused if there is nothing to do
        project.compose("exec", "-T", "supervisor", "pincette", *line)
    return project


@pytest.mark.usefixtures("ready")
def test_the_stock_client_of_sila_grips() -> None:
    grip_by_sila()


def test_a_foxglove_client_sees_the_topics(ready: Project) -> None:
    grip = ready.shell("docker compose exec -T supervisor pincette job grip --force-mN 15", 90.0)
    assert grip.returncode == 0, grip.stdout
    output = on_the_host(block("docs/how-to/foxglove.md", "foxglove.sdk.v1"))
    assert "estimate pincette.Estimate" in output
    assert "services: estop" in output


def test_the_stock_client_of_madsci_grips(ready: Project) -> None:
    page = block("docs/how-to/madsci.md", "RestNodeClient").text
    program = page.split("\n", 1)[1].rpartition("PYTHON")[0]
    line = ["docker", "run", "--rm", "--network", "host", "--entrypoint", "python"]
    done = subprocess.run(
        [*line, "--tmpfs", "/tmp", "--workdir", "/tmp", "pincette-madsci", "-c", program],
        capture_output=True,
        text=True,
        timeout=120.0,
        check=False,
    )
    assert done.returncode == 0, f"{done.stderr}\n{ready.said()}"
    assert done.stdout.count("SUCCEEDED") == 3, done.stdout


def test_an_agent_on_the_host_completes_a_grip(ready: Project) -> None:
    line = ["compose", "run", "--rm", "-T", "agents", "--move"]
    own = {**environment(), **ready.variables}
    server = StdioServerParameters(command="docker", args=line, cwd=ROOT, env=own)

    async def drive() -> tuple[float, str]:
        async with asyncio.timeout(120.0), Client(server) as client:
            plan = (await client.call_tool("plan_grip", {"force_mN": 15.0})).structured_content
            assert plan is not None
            held = (await client.call_tool("grip", {"token": plan["token"]})).structured_content
            assert held is not None
            released = (await client.call_tool("release", {})).structured_content
            assert released is not None
            return held["force_held_mN"], released["part"]

    held_mN, part = asyncio.run(drive())
    assert held_mN == pytest.approx(15.0, abs=1.0)
    assert part == "none"


def test_adapters_publish_their_ports_on_loopback_only(project: Project) -> None:
    found = {name: told("port", project.container(f"{name}-port")) for name in PROFILES}
    assert found == {name: f"{port}/tcp -> 127.0.0.1:{port}" for name, port in PROFILES.items()}


@pytest.mark.usefixtures("project")
@pytest.mark.parametrize("image", ["pincette-adapters", "pincette-madsci"])
def test_the_images_of_adapters_contain_no_build_tools(image: str) -> None:
    found = contents(image)
    assert found.user == 10001
    assert found.tools == []
    assert found.writable == []
