"""MADSci's stock RestNodeClient drives the node of deploy/madsci, in an environment of its own."""

import json
import os
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import httpx
import pytest

from pincette.config.reading import laid_over
from tests.support.checkout import ROOT
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import free_ports, paced_rig
from tests.support.running import RunningRig, running_rig

DEPLOYED = ROOT / "deploy/madsci"
DRIVE = ROOT / "tests/support/madsci_drive.py"
FORCE_MN = 9.0
NEAR_MN = 1.0
LONG_S = 600.0


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    slowly = laid_over(SHORT, {"grip": {"approach_um_per_s": 4.0}})
    with running_rig(paced_rig(slowly), tmp_path_factory.mktemp("rig")) as running:
        make_ready(running)
        yield running


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Of an environment with what requirements.txt names, and this tree's pincette-client."""
    folder = tmp_path_factory.mktemp("madsci")
    wheels = folder / "wheels"
    build = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", str(wheels)]
    run([*build, str(ROOT / "shared")])
    run([sys.executable, "-m", "venv", str(folder / "venv")])
    found = str(folder / "venv/bin/python")
    wanted = ["--find-links", str(wheels), "-r", str(DEPLOYED / "requirements.txt")]
    run([found, "-m", "pip", "install", "--quiet", *wanted])
    return found


def run(command: list[str], cwd: Path | None = None) -> str:
    done = subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=LONG_S, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def node(rig: RunningRig, python: str, tmp_path_factory: pytest.TempPathFactory) -> Generator[str]:
    url = f"http://127.0.0.1:{free_ports(1)}/"
    settings = {"NODE_URL": url, "NODE_SUPERVISOR_URL": rig.rig.supervisor.url}
    folder = tmp_path_factory.mktemp("node")
    log = folder / "node.log"
    with log.open("wb") as sink:
        process = subprocess.Popen(
            [python, str(DEPLOYED / "node.py")],
            cwd=folder,
            env={**os.environ, **settings, "HOME": str(folder)},
            stdout=sink,
            stderr=subprocess.STDOUT,
        )
    try:
        await_answer(f"{url}state", process, log)
        yield url
    finally:
        process.terminate()
        process.wait(20.0)


def await_answer(url: str, process: "subprocess.Popen[bytes]", log: Path) -> None:
    deadline = monotonic() + 120.0
    while True:
        assert process.poll() is None, log.read_text(errors="replace")[-3000:]
        assert monotonic() < deadline, log.read_text(errors="replace")[-3000:]
        try:
            if httpx.get(url, trust_env=False).json().get("part"):
                return
        except (httpx.TransportError, ValueError):
            pass
        sleep(0.2)


def test_the_stock_client_grips_and_is_refused(
    rig: RunningRig, python: str, node: str, tmp_path: Path
) -> None:
    line = [python, str(DRIVE), node, rig.rig.supervisor.url, str(FORCE_MN)]
    said = json.loads(run(line, tmp_path).splitlines()[-1])  # it keeps files where it runs
    assert said["actions"] == ["grip", "plan", "release"]
    assert said["plan"]["status"] == "succeeded"
    for refused, code in (("refused", "limit-violation"), ("infeasible", "InfeasiblePlanError")):
        (error,) = said[refused]["errors"]
        assert error[0] == code
        assert "force 500.000 mN above the limit 40 mN" in error[1]
    held = said["grip"]
    assert held["status"] == "succeeded"
    assert abs(held["json"]["force_held_mN"] - FORCE_MN) < NEAR_MN
    assert said["part"] == "held"
    assert code_of(said["second"]) in ("job-active", "part-held")
    assert said["release"]["json"]["job"] == held["json"]["job"]
    assert code_of(said["nothing"]) == "NothingHeldError"
    assert said["cancelled"]["command"] is True
    assert code_of(said["cancelled"]) == "JobEndedError"
    assert said["stopped"]["command"] is True
    assert code_of(said["stopped"]) == "rig-latched"
    assert code_of(said["latched"]) in ("rig-latched", "estop-engaged")
    assert said["errored"] is False


def code_of(action: dict[str, Any]) -> str:
    assert action["status"] == "failed"
    return action["errors"][0][0]
