"""`pincette up` starts and ends: one line per program, and no process outlives it."""

import os
import re
import signal
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.client import Supervisor
from pincette.core.topics import LOOP
from tests.support.checkout import await_text, until_interrupted
from tests.support.commands import PINCETTE, assert_nothing_is_left, processes_of
from tests.support.rigs import demo_rig, rig_toml

pytestmark = pytest.mark.usefixtures("stalls")

PROGRAMS = {"recorder", "router", "rig", *LOOP, "supervisor"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_process_is_left_after_up_has_ended(tmp_path: Path, number: signal.Signals) -> None:
    rig, path, log = demo_rig(), tmp_path / "rig.toml", tmp_path / "up.log"
    path.write_text(rig_toml(rig), encoding="utf-8")
    command = [*PINCETTE, "up", "--rig", str(path), "--data", str(tmp_path / "data")]
    with until_interrupted(command, tmp_path, log) as process:
        output = await_text(log, "is up at", process, 60.0)
        shown = dict(re.findall(r"^● (\w+) +(\d+) ", output, re.MULTILINE))
        assert shown.keys() == PROGRAMS
        assert {int(one) for one in shown.values()} <= processes_of(path).keys()
        assert max(len(line) for line in output.splitlines()) <= 80
        process.send_signal(number)
        status = process.wait(20.0)
    assert status == (-signal.SIGKILL if number == signal.SIGKILL else 0)
    # A killed `up` cannot stop the others; they end because their standard input has closed.
    assert_nothing_is_left(rig, path, timeout_s=10.0)


def test_an_idle_rig_that_was_stopped_needs_no_person_at_the_next_start(tmp_path: Path) -> None:
    rig, path, log = demo_rig(), tmp_path / "rig.toml", tmp_path / "up.log"
    path.write_text(rig_toml(rig), encoding="utf-8")
    command = [*PINCETTE, "up", "--rig", str(path), "--data", str(tmp_path / "data")]
    url = f"http://{rig.supervisor.host}:{rig.supervisor.port}"
    for last in (False, False, True):
        with (
            until_interrupted(command, tmp_path, log) as process,
            Supervisor(url, timeout_s=60.0, patience_s=60.0) as supervisor,
        ):
            await_text(log, "is up at", process, 60.0)
            desk = supervisor.rig("demo")
            assert desk.state().latch.state == "switched_on"
            if last:
                assert desk.start("grip", hold_s=0.1).wait(60.0).state == "succeeded"


def test_a_killed_router_is_restarted_and_the_part_stays_held(tmp_path: Path) -> None:
    rig, path, log = demo_rig(), tmp_path / "rig.toml", tmp_path / "up.log"
    path.write_text(rig_toml(rig), encoding="utf-8")
    command = [*PINCETTE, "up", "--rig", str(path), "--data", str(tmp_path / "data")]
    with until_interrupted(command, tmp_path, log) as process:
        output = await_text(log, "is up at", process, 60.0)
        pids = dict(re.findall(r"^● (\w+) +(\d+) ", output, re.MULTILINE))
        url = f"http://{rig.supervisor.host}:{rig.supervisor.port}"
        with Supervisor(url, timeout_s=60.0, patience_s=60.0) as supervisor:
            desk = supervisor.rig("demo")
            job = desk.start("grip", until_released=True)
            while "release" not in job.refresh(0.2).allowed_actions:
                assert not job.ended
            os.kill(int(pids["router"]), signal.SIGKILL)
            until_s = monotonic() + 60.0
            while len(served(log, "router")) < 2 or any(
                one.trouble for one in desk.state().programs
            ):
                assert monotonic() < until_s
                sleep(0.1)
            view = desk.state()
            assert (view.part, str(view.latch.state)) == ("held", "armed")
            assert job.refresh().state == "running"
            job.release()
            assert job.wait(30.0).state == "succeeded"
        now = processes_of(path)
        assert {int(pids[name]) for name in PROGRAMS - {"router"}} <= now.keys()


def served(log: Path, program: str) -> list[str]:
    """Return the lines which state that a program serves."""
    text = log.read_text(encoding="utf-8")
    return re.findall(rf"^● {program} .* (?:routes|serves) at", text, re.MULTILINE)
