"""``pincette up`` keeps a held part if its output, its terminal or its REST port is lost."""

import fcntl
import os
import pty
import signal
import subprocess
import termios
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.client import Supervisor
from pincette.core.listening import bound
from tests.support.checkout import await_text, until_interrupted
from tests.support.commands import PINCETTE, assert_nothing_is_left, processes_of
from tests.support.grips import SHORT
from tests.support.rigs import paced_rig, rig_toml

START_S = 120.0


@dataclass
class Output:
    """Standard output of a command, and the event that closes it while the command runs."""

    number: int
    end: Callable[[], None]
    terminal: bool = False
    """True if the output is the controlling terminal of the command."""


@contextmanager
def _full_disk() -> Generator[Output]:
    number = os.open("/dev/full", os.O_WRONLY)
    yield Output(number, lambda: None)
    os.close(number)


@contextmanager
def _paused_reader() -> Generator[Output]:
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writer, bytes(4096))
    os.set_blocking(writer, True)
    yield Output(writer, lambda: None)
    os.close(writer)
    os.close(reader)


@contextmanager
def _lost_terminal() -> Generator[Output]:
    master, slave = pty.openpty()
    yield Output(slave, lambda: os.close(master), terminal=True)


def _started(output: Output, command: list[str]) -> "subprocess.Popen[bytes]":
    def prepare() -> None:
        if output.terminal:
            fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    return subprocess.Popen(
        command,
        stdin=output.number if output.terminal else subprocess.DEVNULL,
        stdout=output.number,
        stderr=output.number,
        start_new_session=True,
        preexec_fn=prepare,
    )


def _supervisor_of(path: Path) -> list[int]:
    return [pid for pid, words in processes_of(path).items() if "run supervisor" in words]


@pytest.mark.parametrize(
    "kind",
    [_lost_terminal, _full_disk, _paused_reader],
    ids=["lost-terminal", "full-disk", "paused-reader"],
)
def test_a_killed_supervisor_is_restarted_and_the_part_stays_held(
    kind: Callable[[], AbstractContextManager[Output]], tmp_path: Path
) -> None:
    rig, path = paced_rig(SHORT), tmp_path / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    command = [*PINCETTE, "up", "--rig", str(path), "--data", str(tmp_path / "data")]
    with kind() as output:
        process = _started(output, command)
        if output.terminal:
            os.close(output.number)
        try:
            with Supervisor(rig.supervisor.url, timeout_s=60.0, patience_s=START_S) as supervisor:
                desk = supervisor.rig("demo")
                job = desk.start("grip", until_released=True)
                while "release" not in job.refresh(0.2).allowed_actions:
                    assert not job.ended
                output.end()
                (before,) = _supervisor_of(path)
                os.kill(before, signal.SIGKILL)
                until_s = monotonic() + START_S
                while _supervisor_of(path) in ([], [before]) and monotonic() < until_s:
                    sleep(0.05)
                view = desk.state()
                assert (view.part, str(view.latch.state)) == ("held", "armed")
                assert process.poll() is None
        finally:
            process.terminate()
            process.wait(30.0)
    assert_nothing_is_left(rig, path, timeout_s=10.0)


def test_a_supervisor_whose_port_was_taken_serves_again_once_it_is_free(tmp_path: Path) -> None:
    rig, path = paced_rig(SHORT), tmp_path / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    command = [*PINCETTE, "up", "--rig", str(path), "--data", str(tmp_path / "data")]
    log = tmp_path / "up.log"
    with (
        until_interrupted(command, tmp_path, log) as process,
        Supervisor(rig.supervisor.url, timeout_s=60.0, patience_s=START_S) as supervisor,
    ):
        desk = supervisor.rig("demo")
        job = desk.start("grip", until_released=True)
        while "release" not in job.refresh(0.2).allowed_actions:
            assert not job.ended
        (before,) = _supervisor_of(path)
        os.kill(before, signal.SIGKILL)
        with _taken(rig.supervisor.host, rig.supervisor.port):
            await_text(log, f":{rig.supervisor.port} is in use", process, START_S)
        view = desk.state()
        assert (view.part, str(view.latch.state)) == ("held", "armed")
        (alarm,) = [one for one in supervisor.alarms(100).alarms if one.cause == "port"]
        assert alarm.clears == "acknowledge"
        assert desk.start("release").wait(60.0).state == "succeeded"


@contextmanager
def _taken(host: str, port: int) -> Generator[None]:
    """Listen at a port as soon as its program has ended."""
    until_s = monotonic() + START_S
    while True:
        try:
            listener = bound(host, port)
            break
        except OSError:
            assert monotonic() < until_s
            sleep(0.005)
    with listener:
        listener.listen()
        yield
