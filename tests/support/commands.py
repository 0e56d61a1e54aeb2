"""The command `pincette` as a process, and checks that nothing of a rig is left on this machine."""

import os
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from time import monotonic, sleep

from pincette.cli.main import main
from pincette.config import RigFile
from pincette.engine.fleet import check_ports

PINCETTE = (sys.executable, "-m", "pincette")


def pincette(*arguments: str | Path, timeout_s: float = 60.0) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    command = [*PINCETTE, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, check=False)


def processor_s(*words: str, status: int | None = 0) -> float:
    """Return the processor time of a Python process; ``status=None`` permits every exit status."""
    process = subprocess.Popen(
        [sys.executable, *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": ""},  # only the first run compiles
    )
    _, ended, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(ended)
    assert status is None or process.returncode == status
    return used.ru_utime + used.ru_stime


def processor_ratio(*words: str, status: int | None = 0, rounds: int = 5) -> float:
    """Return the processor time of a command in multiples of that of an empty Python program.

    Both are measured in turn, so that load on the machine slows both.
    """
    pairs = [
        (processor_s("-m", "pincette", *words, status=status), processor_s("-c", "pass"))
        for _ in range(rounds)
    ]
    return min(one for one, _ in pairs) / min(other for _, other in pairs)


def pincette_here(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a command that starts no program and calls no supervisor, in this process."""
    given = [str(one) for one in arguments]
    with redirect_stdout(StringIO()) as stated, redirect_stderr(StringIO()) as complained:
        status = main(given)
    return subprocess.CompletedProcess(given, status, stated.getvalue(), complained.getvalue())


def processes_of(path: Path) -> dict[int, str]:
    """Return the processes whose command line names a rig file, by their ids."""
    found: dict[int, str] = {}
    for place in Path("/proc").glob("[0-9]*"):
        try:
            words = (place / "cmdline").read_bytes().decode(errors="replace").split("\0")
        except OSError:
            continue
        if str(path) in words:
            found[int(place.name)] = " ".join(words)
    return found


def assert_nothing_is_left(rig: RigFile, path: Path, timeout_s: float = 0.0) -> None:
    """Check that no process of a rig is alive, and that each of its ports is free."""
    deadline = monotonic() + timeout_s
    while monotonic() < deadline and processes_of(path):
        sleep(0.05)
    assert processes_of(path) == {}
    check_ports(rig)
