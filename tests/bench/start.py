"""Measure how long ``pincette demo`` and ``pincette up`` take, on the ports of the demo rig.

``python -m tests.bench.start`` prints the time and the processor time of all programs for each run.
The demo is measured to its end, ``up`` until the rig is up.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from time import monotonic

from tests.support.checkout import await_text, demo_ports

PINCETTE = (sys.executable, "-m", "pincette")
LONG_S = 300.0


def measured(command: str, folder: Path) -> tuple[float, float]:
    """Return the time until a command has done its work, and its processor time, in s."""
    log = folder / f"{command}.log"
    begun_s = monotonic()
    words = [*PINCETTE, command, "--data", str(folder / "data")]
    up_s = None
    with log.open("wb") as sink, subprocess.Popen(words, stdout=sink, stderr=sink) as process:
        try:
            if command == "up":
                await_text(log, "is up at", process, LONG_S)
                up_s = monotonic() - begun_s
                process.send_signal(signal.SIGINT)
            _, ended, used = os.wait4(process.pid, 0)  # including all programs that it has started
        except BaseException:
            process.terminate()
            raise
        process.returncode = os.waitstatus_to_exitcode(ended)
    if process.returncode:
        raise RuntimeError(log.read_text(encoding="utf-8"))
    return up_s or monotonic() - begun_s, used.ru_utime + used.ru_stime


def main() -> None:
    """Measure both commands in turn."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    runs: int = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as folder, demo_ports():
        for _ in range(runs):
            for command in ("up", "demo"):
                taken_s, cpu_s = measured(command, Path(folder))
                print(f"{command:5} {taken_s:5.1f} s, {cpu_s:5.1f} s of processor time", flush=True)


if __name__ == "__main__":
    main()
