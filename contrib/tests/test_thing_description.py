"""The Thing Description is valid by its schema; the stock client node-wot drives a rig by it."""

import json
import re
import shutil
import signal
import subprocess
from collections.abc import Generator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from contrib.support.npm import DRIVE, HOLD, NODE_WOT, node, npm_folder
from tests.support.adapters import FORCE_MN, NEAR_MN, adapter_rig, until
from tests.support.checkout import ROOT
from tests.support.documents import blocks_of
from tests.support.grips import make_ready, restart
from tests.support.running import RunningRig

PAGE = ROOT / "docs/how-to/web-of-things.md"
PORT = "http://127.0.0.1:8000"
"""URL of the supervisor in the program on the page."""
SCHEMA = "node_modules/wot-thing-description-types/schema/td-json-schema-validation.json"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    with adapter_rig(tmp_path_factory.mktemp("rig")) as running:
        make_ready(running)
        yield running


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("node")
    shutil.copy(HOLD, npm_folder(folder, DRIVE, *NODE_WOT))
    return folder


def described(rig: RunningRig, query: str = "") -> Any:
    answer = rig.client.get(f"{rig.rig.supervisor.url}/.well-known/wot{query}")
    return answer.raise_for_status()


def test_the_thing_description_is_valid_by_its_schema(rig: RunningRig, client: Path) -> None:
    answer = described(rig)
    assert answer.headers["content-type"] == "application/td+json"
    schema = json.loads((client / SCHEMA).read_text(encoding="utf-8"))
    validator: Any = jsonschema.Draft7Validator(schema)
    validator.validate(answer.json())


def test_node_wot_grips_with_the_thing_description(rig: RunningRig, client: Path) -> None:
    url = f"{rig.rig.supervisor.url}/.well-known/wot"
    output = node(client, DRIVE.name, url, str(FORCE_MN))
    assert output["title"] == "pincette demo"
    assert output["feasible"] is False
    violation = output["violation"]
    assert (violation["value"], violation["unit"], violation["limit"]) == (500.0, "mN", 40.0)
    assert output["refused"] is not None
    assert abs(output["held_mN"] - FORCE_MN) < NEAR_MN
    assert {"load", "hold"} <= set(output["phases"])
    assert output["live"] > 10
    assert (output["state"], output["stopped"]) == ("succeeded", "stopped")
    assert (output["estop"], output["latch"]) == (True, "latched")
    assert output["latched"] is not None


def test_the_example_program_of_the_documentation_page_completes_a_grip(
    rig: RunningRig, client: Path
) -> None:
    make_ready(rig)
    found = {block.language: block.text for block in blocks_of(PAGE)}
    program = found["js"]
    assert program.count(PORT) == 1
    (client / "grip.js").write_text(program.replace(PORT, rig.rig.supervisor.url))
    done = subprocess.run(
        ["node", "grip.js"], cwd=client, capture_output=True, text=True, timeout=90.0, check=False
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"feasible: true\n1[45]\.\d+ mN", done.stdout), done.stdout
    assert f"npm install {' '.join(NODE_WOT)}\n" == found["sh"]


def test_a_cancel_during_the_request_leaves_no_job(rig: RunningRig, client: Path) -> None:
    make_ready(rig)
    before = len(rig.get("/jobs")["jobs"])
    url, process = f"{rig.rig.supervisor.url}/.well-known/wot", rig.fleet.members["supervisor"]
    output = node(client, HOLD.name, url, "cancel", str(FORCE_MN), str(process.process.pid))
    until(lambda: rig.view()["active_job"] is None, "the request went on")
    begun = rig.get("/jobs")["jobs"]
    assert {job["state"] for job in begun[: len(begun) - before]} <= {"stopped"}, output


def test_a_disconnected_client_and_a_stopped_supervisor_leave_the_part_held(
    rig: RunningRig, client: Path
) -> None:
    make_ready(rig)
    url = f"{rig.rig.supervisor.url}/.well-known/wot"
    line = ["node", HOLD.name, url, "grip", str(FORCE_MN)]

    def gripped_and_killed() -> str:
        with subprocess.Popen(line, cwd=client, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            job = json.loads(process.stdout.readline())["job"]
            process.kill()
        until(lambda: rig.view()["part"] == "held" or rig.job(job)["ended_at"], "it goes on")
        assert rig.view()["part"] == "held", rig.job(job)["cause"]
        return job

    job = gripped_and_killed()
    output = node(client, HOLD.name, url, "release")
    assert output == {"part": "held", "job": job, "state": "succeeded"}
    gripped_and_killed()
    rig.fleet.signal("supervisor", signal.SIGKILL)
    rig.fleet.members["supervisor"].process.wait(5.0)
    gone = subprocess.run(
        ["node", HOLD.name, url, "release"],
        cwd=client,
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert gone.returncode == 1
    assert "ECONNREFUSED" in gone.stderr
    restart(rig, "supervisor")
    until(lambda: rig.view()["part"] == "held", "the part is not held")
    output = node(client, HOLD.name, url, "release")
    assert output == {"part": "held", "job": None, "state": "succeeded"}
    assert rig.view()["part"] == "none"


def test_a_request_for_a_thing_description_may_name_the_rig(rig: RunningRig) -> None:
    assert described(rig, "?rig=demo").json() == described(rig).json() | {"links": []}
    assert described(rig).json()["security"] == "none"
    unknown = rig.client.get(f"{rig.rig.supervisor.url}/.well-known/wot?rig=no-such")
    assert unknown.status_code == 404
