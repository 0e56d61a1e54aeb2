"""Each extra starts and answers one request, in a separate environment for each Python version."""

import asyncio
import json
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest
from mcp import Client, StdioServerParameters
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from pincette.config import read_rig
from tests.support.adapters import adapter_rig, ports_of_adapters
from tests.support.checkout import ROOT
from tests.support.environments import environment, python_of, ran, wheel
from tests.support.grips import make_ready
from tests.support.postgres import server
from tests.support.rigs import DEMO, at_own_ports, rig_toml
from tests.support.running import RunningRig

pytestmark = pytest.mark.slow

PYTHONS = ("3.11", "3.12", "3.13")
READY_S = 120.0
OF_SILA = """\
import sys
from sila2.client import SilaClient
with SilaClient("127.0.0.1", int(sys.argv[1]), insecure=True) as client:
    print(client.Microgripper.Plan(9.0, 0.0, "").Feasible)
"""
OF_BLUESKY = """\
import sys
import bluesky.plan_stubs as bps
from bluesky.run_engine import RunEngine
from ophyd_async.core import init_devices
from pincette_bluesky import Gripper
engine = RunEngine({}, context_managers=[])
with init_devices():
    gripper = Gripper(sys.argv[1])
def plan():
    yield from bps.open_run()
    read = yield from bps.trigger_and_read([gripper])
    print(read["gripper-part"]["value"])
    yield from bps.close_run()
engine(plan())
"""
OF_NIDAQMX = """\
import sys
from pathlib import Path
from pincette.config import read_rig
from pincette_nidaqmx.position_sensor import open_sensor
print(open_sensor(read_rig(Path(sys.argv[1])).sensor).read_um())
"""
OF_CLUSTER = """\
import sys
from pathlib import Path
import distributed
from pincette.config import read_rig
from pincette.control.laws.dsmifc import LAW
from pincette_study.closed_loop import track, tracking_plan
from pincette_study.rigs import frozen_rig
def errors(K_f):
    rig = frozen_rig(read_rig(Path(sys.argv[1])))
    settings = LAW.settings("consistent").with_gains(K_f=K_f)
    found = track(rig, settings, tracking_plan(rig, cycles=1))[1]
    return found.position_um, found.force_mN
if __name__ == "__main__":
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as one,
        distributed.Client(one) as client,
    ):
        there = list(client.get_executor().map(errors, [2000.0, 4000.0]))
    print(there == [errors(2000.0), errors(4000.0)])
"""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    with adapter_rig(tmp_path_factory.mktemp("rig"), ports_of_adapters()) as running:
        make_ready(running)
        yield running


@pytest.fixture(params=PYTHONS)
def python(request: pytest.FixtureRequest) -> str:
    return python_of(request.param)


@contextmanager
def started(python: Path, name: str, rig: Path, folder: Path) -> Generator[None]:
    """A program of an environment that runs until the end of the block."""
    script = str(python.with_name("pincette"))
    line = [script, "run", name, "--rig", str(rig), "--data", str(folder)]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, cwd=folder) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("ready"), process.poll()
            yield
        finally:
            process.terminate()
            process.wait(READY_S)


def whole(extra: str) -> list[str]:
    """List the wheels of pincette with an extra, and of the package of contrib that it needs."""
    return [f"pincette[{extra}] @ {wheel('.').as_uri()}", str(wheel("shared")), *package(extra)]


def package(extra: str) -> list[str]:
    project = f"contrib/{extra}"
    return [str(wheel(project))] if (ROOT / project).is_dir() else []


def client_with(extra: str) -> list[str]:
    return [f"pincette-client[{extra}] @ {wheel('shared').as_uri()}", *package(extra)]


def test_the_sila_extra_works(rig: RunningRig, python: str, tmp_path: Path) -> None:
    own = environment(tmp_path / "venv", *whole("sila"), python=python)
    with started(own, "sila", rig.path, tmp_path):
        output = ran([str(own), "-I", "-c", OF_SILA, str(rig.rig.sila.port)], tmp_path)
    assert output == "True\n"


def test_the_foxglove_extra_works(rig: RunningRig, python: str, tmp_path: Path) -> None:
    own = environment(tmp_path / "venv", *whole("foxglove"), python=python)
    address = f"ws://127.0.0.1:{rig.rig.foxglove.port}"
    spoken = [Subprotocol("foxglove.sdk.v1")]
    with (
        started(own, "foxglove", rig.path, tmp_path),
        connect(address, subprotocols=spoken, max_size=None) as line,
    ):
        assert json.loads(line.recv(timeout=READY_S))["name"] == "pincette demo"


def test_the_bluesky_extra_works(rig: RunningRig, python: str, tmp_path: Path) -> None:
    own = environment(tmp_path / "venv", *client_with("bluesky"), python=python)
    output = ran([str(own), "-I", "-c", OF_BLUESKY, rig.rig.supervisor.url], tmp_path)
    assert output in ("none\n", "unknown\n")


def test_the_mcp_extra_works(rig: RunningRig, python: str, tmp_path: Path) -> None:
    own = environment(tmp_path / "venv", *client_with("mcp"), python=python)
    script = str(own.with_name("pincette-mcp"))
    server = StdioServerParameters(command=script, args=["--url", rig.rig.supervisor.url])

    async def status() -> str:
        async with asyncio.timeout(READY_S), Client(server) as client:
            answer = (await client.call_tool("status", {})).structured_content
            assert answer is not None
            return answer["part"]

    assert asyncio.run(status()) in ("none", "unknown")


def test_the_cluster_extra_works(python: str, tmp_path: Path) -> None:
    own = environment(
        tmp_path / "venv", *whole("cluster"), str(wheel("contrib/study")), python=python
    )
    script = tmp_path / "sweep.py"
    script.write_text(OF_CLUSTER, encoding="utf-8")
    assert ran([str(own), "-I", str(script), str(DEMO)], tmp_path).splitlines()[-1] == "True"


def test_the_nidaqmx_extra_works(python: str, tmp_path: Path) -> None:
    """The simulated device of the fast rig, and a position that the driver reads."""
    own = environment(tmp_path / "venv", *whole("nidaqmx"), python=python)
    fast = at_own_ports(read_rig(ROOT / "deploy/rigs/fast.toml"))
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(fast), encoding="utf-8")
    with started(own, "router", path, tmp_path), started(own, "rig", path, tmp_path):
        output = ran([str(own), "-I", "-c", OF_NIDAQMX, str(path)], tmp_path)
    assert fast.sensor.minimum_um <= float(output) <= fast.sensor.maximum_um


def test_the_postgresql_extra_works(python: str, tmp_path: Path) -> None:
    own = environment(tmp_path / "venv", *whole("postgresql"), python=python)
    line = [str(own.with_name("pincette")), "key", "list", "--data", str(tmp_path / "data")]
    with server() as postgres:
        ran(line, tmp_path, {"PINCETTE_STORE": postgres.database("bench")})
        nowhere = postgres.database("other").replace("/other?", "/no_such?")
        with pytest.raises(AssertionError, match="no_such"):
            ran(line, tmp_path, {"PINCETTE_STORE": nowhere})


def test_a_program_without_its_extra_reports_what_is_missing(
    rig: RunningRig, tmp_path: Path
) -> None:
    own = environment(tmp_path / "venv", str(wheel(".")), str(wheel("shared")))
    for extra in ("sila", "foxglove"):
        command = [str(own.with_name("pincette")), "run", extra, "--rig", str(rig.path)]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=READY_S, check=False, cwd=tmp_path
        )
        assert done.returncode == 2, done.stderr
        assert f"pip install 'pincette[{extra}]'" in done.stderr
