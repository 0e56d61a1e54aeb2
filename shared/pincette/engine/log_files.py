"""Log files of the programs of ``pincette up``, kept across starts and bounded in size.

A program writes to its file over an inherited descriptor in append mode. A full file is therefore
copied to the next name and emptied, as logrotate does with ``copytruncate``: the program continues
to write to the same descriptor, and never waits for the rotation.
"""

import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import TextIO

from pincette.core import files

FULL_BYTES = 4_000_000
"""Length at which a file is rotated, in bytes."""
KEPT = 4
"""Number of older files that are kept, as NAME.log.1 (the newest) to NAME.log.4."""


def make_folder(folder: Path) -> None:
    """Create the folder of log files, which other accounts cannot enter."""
    files.make_folder(folder, 0o700)
    folder.chmod(0o700)


def open_to_append(log: Path) -> TextIO:
    """Open a log file, which only this account may read; its content is kept.

    Its folder is created again if it was removed. Raises OSError.
    """
    make_folder(log.parent)
    rotate_if_full(log)
    number = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
    os.fchmod(number, 0o600)
    return os.fdopen(number, "a", encoding="utf-8")


def rotate_if_full(log: Path, full_bytes: int = FULL_BYTES) -> None:
    """Move the content of a full log file to the next name, or drop it if the disk is full."""
    try:
        if log.stat().st_size < full_bytes:
            return
    except OSError:
        return
    with suppress(OSError):
        for number in range(KEPT, 1, -1):
            older = _older(log, number - 1)
            if older.exists():
                older.replace(_older(log, number))
        newest = _older(log, 1)
        shutil.copyfile(log, newest)
        newest.chmod(0o600)
    with suppress(OSError):
        os.truncate(log, 0)


def _older(log: Path, number: int) -> Path:
    return log.with_name(f"{log.name}.{number}")
