"""A grip with only the wheel of pincette-client and the oldest pydantic that it allows."""

import json
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.support.environments import environment, python_of, ran, wheel
from tests.support.grips import SHORT
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig

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
    "recorded": [one.phase for one in result.phases],
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


@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_the_thin_client_grips(rig: RunningRig, tmp_path: Path, version: str) -> None:
    wanted = (str(wheel("shared")), "pydantic==2.12.0")
    python = environment(tmp_path / "venv", *wanted, python=python_of(version))
    content = json.loads(ran([str(python), "-I", "-c", GRIP, rig.rig.supervisor.url]))
    assert content["pydantic"] == "2.12.0"
    assert content["rest"] == [False, False], (
        "modules of pincette that do not belong to the client are loaded"
    )
    assert content["feasible"] is False
    violation, code = content["refused"]
    assert code == "limit-violation"
    assert (violation["value"], violation["unit"], violation["limit"]) == (500.0, "mN", 40.0)
    assert content["phases"] == content["recorded"]
    assert (content["state"], content["outcome"]) == ("succeeded", "gripped")
    assert abs(content["force_held_mN"] - 9.0) < 1.0
