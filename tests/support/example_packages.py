"""Packages of the how-to guides, installed into a separate folder."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "docs/examples"


def installed(name: str, folders: pytest.TempPathFactory) -> Path:
    """Install an example from a copy, so that no files are left next to it; returns the folder."""
    copy = folders.mktemp("source") / name
    shutil.copytree(EXAMPLES / name, copy, ignore=shutil.ignore_patterns("__pycache__"))
    target = folders.mktemp("installed")
    options = ["--isolated", "--disable-pip-version-check", "--no-deps", "--no-build-isolation"]
    command = [sys.executable, "-m", "pip", "install", *options, "--no-index", "--quiet"]
    done = subprocess.run(
        [*command, "--target", target, copy],
        capture_output=True,
        text=True,
        timeout=120.0,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return target


def python_path(folder: Path) -> str:
    """Return a PYTHONPATH with a folder before the existing entries."""
    before = os.environ.get("PYTHONPATH")
    return os.pathsep.join([str(folder), *([before] if before else [])])
