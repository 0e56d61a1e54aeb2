"""The Thing Description is valid by its schema; the stock client node-wot drives a rig by it."""

import json
import shutil
import subprocess
from collections.abc import Generator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from tests.support.checkout import ROOT
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import demo_rig, paced_rig
from tests.support.running import RunningRig, running_rig

PACKAGES = (
    "@node-wot/core@0.9.2",
    "@node-wot/binding-http@0.9.2",
    "wot-thing-description-types@1.1.0-12-March-2025",
)
SCHEMA = "node_modules/wot-thing-description-types/schema/td-json-schema-validation.json"
DRIVE = ROOT / "tests/support/node_wot/drive.js"
FORCE_MN = 9.0
NEAR_MN = 1.0
LONG_S = 300.0


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    with running_rig(paced_rig(SHORT), tmp_path_factory.mktemp("rig")) as running:
        make_ready(running)
        yield running


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("node")
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        pytest.skip("node and npm are missing: node-wot does not drive the rig")
    line = [npm, "install", "--prefix", str(folder), "--no-audit", "--no-fund", *PACKAGES]
    done = subprocess.run(line, capture_output=True, text=True, timeout=LONG_S, check=False)
    if done.returncode:
        pytest.skip(f"npm cannot install node-wot: {done.stderr.strip()[-300:]}")
    shutil.copy(DRIVE, folder)
    return folder


def described(rig: RunningRig, query: str = "") -> Any:
    answer = rig.client.get(f"{rig.rig.supervisor.url}/.well-known/wot{query}")
    return answer.raise_for_status()


def test_it_is_valid_by_the_schema_of_the_standard(rig: RunningRig, client: Path) -> None:
    answer = described(rig)
    assert answer.headers["content-type"] == "application/td+json"
    schema = json.loads((client / SCHEMA).read_text(encoding="utf-8"))
    validator: Any = jsonschema.Draft7Validator(schema)
    validator.validate(answer.json())


def test_node_wot_grips_by_it(rig: RunningRig, client: Path) -> None:
    url = f"{rig.rig.supervisor.url}/.well-known/wot"
    line = ["node", "drive.js", url, str(FORCE_MN)]
    done = subprocess.run(
        line, cwd=client, capture_output=True, text=True, timeout=LONG_S, check=False
    )
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout.splitlines()[-1])
    assert said["title"] == "pincette demo"
    assert said["feasible"] is False
    violation = said["violation"]
    assert (violation["value"], violation["unit"], violation["limit"]) == (500.0, "mN", 40.0)
    assert said["refused"] is not None
    assert abs(said["held_mN"] - FORCE_MN) < NEAR_MN
    assert {"load", "hold"} <= set(said["phases"])
    assert said["live"] > 10
    assert (said["state"], said["stopped"]) == ("succeeded", "stopped")
    assert (said["estop"], said["latch"]) == (True, "latched")
    assert said["latched"] is not None


def test_keys_and_other_rigs_are_told(tmp_path: Path) -> None:
    with running_rig(demo_rig(SHORT, time="lockstep"), tmp_path) as rig:
        assert described(rig, "?rig=demo").json() == described(rig).json() | {"links": []}
        assert described(rig).json()["security"] == "none"
        unknown = rig.client.get(f"{rig.rig.supervisor.url}/.well-known/wot?rig=no-such")
        assert unknown.status_code == 404
