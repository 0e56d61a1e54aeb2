"""The worker process of the supervisor: its work, and its end."""

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


def test_the_worker_runs_in_its_own_process_with_lower_priority(worker: Worker) -> None:
    assert worker.run(factorial, 20) == factorial(20)
    assert worker.pid != os.getpid()
    assert worker.run(os.nice, 0) >= 10


def test_an_exception_in_the_worker_is_raised_in_the_caller(worker: Worker) -> None:
    with pytest.raises(ValueError, match="not defined for negative values"):
        worker.run(factorial, -1)


def test_a_killed_worker_is_restarted(worker: Worker) -> None:
    worker.run(factorial, 1)
    killed = worker.pid
    os.kill(killed, signal.SIGKILL)
    assert worker.run(factorial, 5) == 120
    assert worker.pid != killed


def test_an_unused_worker_ends_and_is_started_again_on_demand(
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


def test_the_worker_ends_with_a_killed_supervisor(tmp_path: Path) -> None:
    script = tmp_path / "killed.py"
    script.write_text(KILLED, encoding="utf-8")
    output = subprocess.run(
        [sys.executable, script], stdout=subprocess.PIPE, text=True, timeout=WAIT_S, check=False
    )
    assert output.returncode == -signal.SIGKILL
    pid, deadline = int(output.stdout.split()[-1]), monotonic() + WAIT_S
    while Path(f"/proc/{pid}").exists():
        assert monotonic() < deadline
        sleep(0.01)


def test_a_worker_that_cannot_start_is_logged_and_started_later(
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
