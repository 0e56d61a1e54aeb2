"""A folder whose files cannot be locked, as on some network shares, for programs of a test.

``no_locks.c`` is compiled and preloaded: the programs' own calls of ``flock`` and ``fcntl`` fail,
those of SQLite included.
"""

import os
import shutil
import subprocess
from pathlib import Path

SOURCE = Path(__file__).with_name("no_locks.c")


def objection() -> str:
    """Return why nothing can be compiled here; empty if it can."""
    return "" if shutil.which("cc") else "not installed: cc (Debian: gcc, libc6-dev)"


def library(folder: Path) -> Path:
    """Compile the library and return its path."""
    made = folder / "no_locks.so"
    command = ["cc", "-shared", "-fPIC", "-O1", "-o", str(made), str(SOURCE), "-ldl"]
    subprocess.run(command, check=True, capture_output=True, timeout=60.0)
    return made


def environment(made: Path, below: Path, number: int) -> dict[str, str]:
    """Return variables under which locks of files below a folder fail with an error number."""
    return {
        **os.environ,
        "LD_PRELOAD": str(made),
        "NO_LOCKS_BELOW": str(below.resolve()),
        "NO_LOCKS_ERRNO": str(number),
    }
