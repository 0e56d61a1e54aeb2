"""The wheel of pincette-client alone, with the oldest pydantic that it admits, grips."""

import json
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.support.checkout import ROOT
from tests.support.grips import SHORT
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig

LONG_S = 600.0
GRIP = """\
import importlib.util, json, sys
from importlib.metadata import version
from pincette.client import ProblemError, Supervisor

with Supervisor(sys.argv[1]) as supervisor:
    rig = supervisor.rig()
    plan = rig.plan("grip", force_mN=500.0)
    try:
        rig.start("grip", force_mN=500.0)
        refused = None
    except ProblemError as error:
        refused = [dict(error.violations[0]), error.code]
    job = rig.start("grip", force_mN=9.0)
    sample = next(rig.live())
    phases = [event.body["phase"] for event in job.events() if event.kind == "phase"]
    job.wait(120.0)
    result = job.result()
print(json.dumps({
    "pydantic": version("pydantic"),
    "rest": [bool(importlib.util.find_spec(f"pincette.{name}")) for name in ("config", "bus")],
    "feasible": plan.feasible,
    "warnings": plan.warnings,
    "refused": refused,
    "seq": sample.seq,
    "phases": phases,
    "state": job.state,
    "outcome": result.outcome,
    "force_held_mN": result.force_held_mN,
}))
"""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    shorter = demo_rig(SHORT, time="lockstep")
    with running_rig(shorter, tmp_path_factory.mktemp("rig")) as running:
        yield running


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--no-isolation", "--wheel"]
    run([*build, "--outdir", str(folder), str(ROOT / "shared")])
    (found,) = folder.iterdir()
    return found


def run(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONG_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("version", ["3.11", "3.12"])
def test_the_thin_client_grips(rig: RunningRig, wheel: Path, tmp_path: Path, version: str) -> None:
    found = subprocess.run(
        ["sh", str(ROOT / "requirements/python.sh"), version],
        capture_output=True,
        text=True,
        check=False,
    )
    if found.returncode:
        pytest.skip(found.stderr.strip())  # names the Python that is missing
    run([found.stdout.strip(), "-m", "venv", str(tmp_path / "venv")])
    python = str(tmp_path / "venv/bin/python")
    run([python, "-m", "pip", "install", "--quiet", str(wheel), "pydantic==2.12.0"])
    run([python, "-m", "pip", "check"])
    supervisor = rig.rig.supervisor
    url = f"http://{supervisor.host}:{supervisor.port}"
    said = json.loads(run([python, "-I", "-c", GRIP, url]))
    assert said["pydantic"] == "2.12.0"
    assert said["rest"] == [False, False], "a part of pincette that is not the client's"
    assert said["feasible"] is False
    violation, code = said["refused"]
    assert code == "limit-violation"
    assert (violation["value"], violation["unit"], violation["limit"]) == (500.0, "mN", 40.0)
    assert said["phases"][-1] == "retreat"
    assert "hold" in said["phases"]
    assert (said["state"], said["outcome"]) == ("succeeded", "gripped")
    assert abs(said["force_held_mN"] - 9.0) < 1.0
