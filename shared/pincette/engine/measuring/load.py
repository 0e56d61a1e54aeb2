"""Programs that load a machine while it is measured: one on each processor, one on the disk."""

import os
import subprocess
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic

from pincette.core.files import temporary_folder

BLOCK = 1 << 20
BLOCKS = 64
"""Number of blocks of a mebibyte that are written before the writer starts again at the front."""


@contextmanager
def load(for_s: float) -> Generator[None]:
    """Load every processor and the disk; the programs end automatically after ``for_s``."""
    wanted = [["cpu"] for _ in range(os.cpu_count() or 1)]
    with temporary_folder() as folder:
        wanted.append(["disk", str(folder / "block")])
        programs = [
            subprocess.Popen([sys.executable, "-m", __name__, str(for_s), *words])
            for words in wanted
        ]
        try:
            yield
        finally:
            for program in programs:
                program.terminate()
            for program in programs:
                program.wait()


def burn(end_s: float) -> None:
    """Keep a processor busy."""
    while monotonic() < end_s:
        sum(range(10_000))


def write(path: Path, end_s: float) -> None:
    """Write to the disk, and wait until the data have been written."""
    block = os.urandom(BLOCK)
    with path.open("wb", buffering=0) as file:
        while True:
            file.write(block)
            os.fsync(file.fileno())
            if monotonic() >= end_s:
                return
            if file.tell() >= BLOCKS * BLOCK:
                file.seek(0)


def main(words: Sequence[str]) -> None:
    """Run one of the programs for the given number of seconds."""
    end_s = monotonic() + float(words[0])
    if words[1] == "cpu":
        burn(end_s)
    else:
        write(Path(words[2]), end_s)


if __name__ == "__main__":
    main(sys.argv[1:])
