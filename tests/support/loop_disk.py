"""A separate ext4 file system in an image file, and copies of it as after a power cut.

A copy contains what the file system has written to its disk by then. Nothing is synced for it, so
data that are only in the memory of the kernel are lost, as in a power failure.
"""

import filecmp
import os
import shutil
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

SIZE_MB = 96
MOST_COPIES = 200
"""Attempts to copy the image while nothing is written to it."""


class LoopDisk:
    """A mounted image."""

    def __init__(self, image: Path, root: Path) -> None:
        self._image, self.root = image, root

    def cut(self, target: Path) -> Path:
        """Copy the image as it is at one moment, without a sync; returns the copy."""
        # A copy takes time. Two equal consecutive copies show that nothing was written meanwhile.
        again = target.with_name(f"{target.name}.again")
        _copy(self._image, target)
        for _ in range(MOST_COPIES):
            _copy(self._image, again)
            if filecmp.cmp(target, again, shallow=False):
                again.unlink()
                return target
            again.replace(target)
        raise AssertionError(f"{self._image} was never idle long enough to be copied")


def _copy(image: Path, target: Path) -> None:
    subprocess.run(["cp", "--sparse=always", str(image), str(target)], check=True)


@contextmanager
def loop_disk(folder: Path, size_MB: int = SIZE_MB) -> Generator[LoopDisk]:
    """Make a file system and mount it; skips, and prints why, if that is not possible."""
    image = folder / "disk.img"
    with image.open("wb") as file:
        file.truncate(size_MB * 2**20)
    if shutil.which("mkfs.ext4") is None:
        pytest.skip("mkfs.ext4 (package e2fsprogs) is missing: no disk can be cut off")
    subprocess.run(["mkfs.ext4", "-q", "-F", str(image)], check=True)
    with mounted(image, folder / "disk") as root:
        yield LoopDisk(image, root)


@contextmanager
def mounted(image: Path, root: Path) -> Generator[Path]:
    """Mount an image, which recovers its journal; skips, and prints why, if that is not
    possible."""
    if os.geteuid() != 0:
        pytest.skip("only root may mount a disk that a test can cut off")
    root.mkdir(exist_ok=True)
    found = subprocess.run(
        ["mount", "-o", "loop", str(image), str(root)], capture_output=True, text=True, check=False
    )
    if found.returncode:
        pytest.skip(f"no image can be mounted here: {found.stderr.strip()}")
    try:
        yield root
    finally:
        subprocess.run(["umount", "--lazy", str(root)], check=True)
