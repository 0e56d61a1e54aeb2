"""The process beside the supervisor: what it does, and when it ends."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from math import factorial
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette_supervisor.planning import worker as worker_module
from pincette_supervisor.planning.worker import Worker

WAIT_S = 20.0
KILLED = """
import os
from pincette_supervisor.planning.worker import Worker

if __name__ == "__main__":
    worker = Worker()
    worker.run(abs, 1)
    print(worker.pid, flush=True)
    os.kill(os.getpid(), 9)
"""


@pytest.fixture
def worker() -> Iterator[Worker]:
    found = Worker()
    yield found
    found.close()


def test_it_works_in_a_process_of_its_own_and_stands_back(worker: Worker) -> None:
    assert worker.run(factorial, 20) == factorial(20)
    assert worker.pid != os.getpid()
    assert worker.run(os.nice, 0) >= 10


def test_what_fails_there_is_raised_here(worker: Worker) -> None:
    with pytest.raises(ValueError, match="not defined for negative values"):
        worker.run(factorial, -1)


def test_one_that_was_killed_is_begun_again(worker: Worker) -> None:
    worker.run(factorial, 1)
    killed = worker.pid
    os.kill(killed, signal.SIGKILL)
    assert worker.run(factorial, 5) == 120
    assert worker.pid != killed


def test_one_that_is_not_used_ends_and_begins_again(
    worker: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker_module, "UNUSED_S", 0.1)
    worker.begin()
    assert worker.run(factorial, 5) == 120
    ended, deadline = worker.pid, monotonic() + WAIT_S
    while worker.pid or Path(f"/proc/{ended}").exists():
        assert monotonic() < deadline
        sleep(0.01)
    worker.run(sleep, 0.5)  # longer than it may be unused
    assert worker.run(factorial, 3) == 6


def test_it_ends_with_a_supervisor_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "killed.py"
    script.write_text(KILLED, encoding="utf-8")
    said = subprocess.run(
        [sys.executable, script], stdout=subprocess.PIPE, text=True, timeout=WAIT_S, check=False
    )
    assert said.returncode == -signal.SIGKILL
    pid, deadline = int(said.stdout.split()[-1]), monotonic() + WAIT_S
    while Path(f"/proc/{pid}").exists():
        assert monotonic() < deadline
        sleep(0.01)


def test_one_that_cannot_begin_is_logged_and_begins_once_it_can(
    worker: Worker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def no_room(*_words: object, **_settings: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(worker_module, "ProcessPoolExecutor", no_room)
        worker.begin()
        assert "/dev/shm" in caplog.text
        with pytest.raises(OSError, match="/dev/shm"):
            worker.run(factorial, 1)
    assert worker.run(factorial, 3) == 6
