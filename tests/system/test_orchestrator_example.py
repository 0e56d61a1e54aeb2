"""The example of an orchestrator as a cell runs it: a separate process, and a rig in lockstep."""

import re
import signal
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.config.reading import laid_over
from tests.support.checkout import ROOT, await_text, run, until_interrupted
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig
from tests.support.technician import Technician

EXAMPLE = ROOT / "docs/examples/orchestrator.py"
PATIENCE_S = 120.0
HANDS = {"simulation": {"scripts": True}}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    handled = demo_rig(laid_over(SHORT, HANDS), time="lockstep")
    with running_rig(handled, tmp_path_factory.mktemp("cell")) as running:
        yield running


@pytest.fixture
def hands(rig: RunningRig) -> Generator[Technician]:
    person = Technician.at(rig)
    yield person
    make_ready(rig, PATIENCE_S)
    person.do("part", "place", rig.rig.part.contact_um)
    person.leave()
    refresh(rig)


def refresh(rig: RunningRig) -> None:
    """Bring the arm back after a hold: while it creeps, its force cannot be zeroed."""
    body = {"kind": "move", "to_V": rig.rig.safety.safe_V, "conditioning_cycles": 5}
    taken = rig.post("/jobs", {**body, "zero": False, "autostart": True})
    assert taken.status_code == 201, taken.text
    assert rig.ended(taken.json()["id"], PATIENCE_S)["state"] == "succeeded"


def until_free(rig: RunningRig) -> None:
    """Wait until a part is released."""
    deadline = monotonic() + PATIENCE_S
    while not (view := rig.view())["can_start"]:
        assert monotonic() < deadline, view["reasons"]
        sleep(0.05)


def command(rig: RunningRig, *words: str) -> list[str]:
    url = str(rig.client.base_url).removesuffix("/").removesuffix("/api/v1")
    return [sys.executable, "-u", str(EXAMPLE), "--url", url, "--force-mN", "8", *words]


def ended(rig: RunningRig, folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    return run(command(rig, "--work-s", "0.2", *words), folder, PATIENCE_S)


def newest(rig: RunningRig) -> Json:
    return rig.get("/jobs", limit=1)["jobs"][0]


def test_parts_are_picked_held_and_released(rig: RunningRig, tmp_path: Path) -> None:
    done = ended(rig, tmp_path, "--parts", "2")
    assert done.returncode == 0, done.stdout
    jobs = re.findall(r"part-\d: released, peak force \d+\.\d\d mN, job (\S+)", done.stdout)
    assert len(jobs) == len(set(jobs)) == 2
    for job in (rig.ended(name) for name in jobs):
        assert (job["state"], job["record_complete"]) == ("succeeded", True)
        assert job["result"]["force_held_mN"] == pytest.approx(8.0, abs=0.5)
        assert [action["type"] for action in job["actions"]][-1] == "release"
    assert rig.view()["part"] == "none"


def test_a_missing_part_is_reported_and_the_run_continues(
    rig: RunningRig, hands: Technician, tmp_path: Path
) -> None:
    hands.do("part", "remove")
    done = ended(rig, tmp_path, "--parts", "2")
    assert done.returncode == 1, done.stdout
    assert len(re.findall(r"part-\d: ended before its hold: .*no_contact", done.stdout)) == 2
    assert rig.view()["can_start"]


def test_a_part_that_is_lost_while_the_cell_works_is_reported(
    rig: RunningRig, hands: Technician, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    with until_interrupted(command(rig, "--work-s", "2"), tmp_path, log) as process:
        await_text(log, "the cell works", process, PATIENCE_S)
        hands.do("part", "lose")
        assert process.wait(PATIENCE_S) == 1, log.read_text(encoding="utf-8")
    assert re.search(r"part-1: failed: .*lost", log.read_text(encoding="utf-8"))


@pytest.mark.usefixtures("hands")
def test_a_latched_rig_needs_a_person(rig: RunningRig, tmp_path: Path) -> None:
    rig.post(f"/rigs/{rig.rig.rig.name}/estop").raise_for_status()
    done = ended(rig, tmp_path, "--parts", "2")
    assert done.returncode == 4, done.stdout
    assert "a person is needed: " in done.stdout
    assert "reset" in done.stdout
    assert "Traceback" not in done.stdout


@pytest.mark.usefixtures("hands")
def test_ctrl_c_keeps_the_part_held(rig: RunningRig, tmp_path: Path) -> None:
    log = tmp_path / "log"
    with until_interrupted(command(rig, "--work-s", "60"), tmp_path, log) as process:
        await_text(log, "the cell works", process, PATIENCE_S)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 130, log.read_text(encoding="utf-8")
    assert "Traceback" not in log.read_text(encoding="utf-8")
    job = rig.ended(newest(rig)["id"], PATIENCE_S)
    assert (job["state"], rig.view()["part"]) == ("stopped", "held"), job["cause"]
    rig.post(f"/jobs/{job['id']}/actions", {"type": "release"}).raise_for_status()
    until_free(rig)


def test_a_missing_supervisor_is_reported(tmp_path: Path) -> None:
    words = [sys.executable, str(EXAMPLE), "--url", "http://127.0.0.1:9", "--patience-s", "0.2"]
    done = run(words, tmp_path, PATIENCE_S)
    assert done.returncode == 4
    assert "a person is needed: " in done.stdout
    assert "Traceback" not in done.stdout
