"""Separate environments with this tree's wheels, for packages that conflict with those of the
tests."""

import os
import runpy
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from tests.support.checkout import ROOT

LONG_S = 600.0


def ran(command: list[str], cwd: Path | None = None, more: Mapping[str, str] | None = None) -> str:
    """Return the output of a command; raises AssertionError with both outputs if it fails.

    ``more``: environment variables in addition to those of this process.
    """
    done = subprocess.run(
        command,
        cwd=cwd,
        env={**os.environ, **(more or {})},
        capture_output=True,
        text=True,
        timeout=LONG_S,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout


def python_of(version: str) -> str:
    """Return the path of a Python such as 3.12; skips if this machine has none."""
    line = ["sh", str(ROOT / "requirements/python.sh"), version]
    found = subprocess.run(line, capture_output=True, text=True, check=False)
    if found.returncode:
        pytest.skip(found.stderr.strip())  # the skip names the Python that is missing
    return found.stdout.strip()


@cache
def _kept() -> "TemporaryDirectory[str]":
    return TemporaryDirectory(prefix="pincette-wheels-")


@cache
def wheel(project: str) -> Path:
    """Return the wheel of ``.`` or ``shared``, built once per process."""
    folder = Path(_kept().name) / project.replace(".", "whole")
    build = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", str(folder)]
    ran([*build, str(ROOT / project)])
    (found,) = folder.iterdir()
    return found


def environment(folder: Path, *wanted: str, python: str = sys.executable) -> Path:
    """Make an environment with some packages and our wheels that they need; returns its Python."""
    uv = str(Path(sys.executable).with_name("uv"))
    script: dict[str, Any] = runpy.run_path(str(ROOT / "requirements/install.py"))
    config = ran([sys.executable, "-m", "pip", "config", "list"])
    settings: dict[str, str] = script["uv_settings"](config)
    ran([uv, "venv", "--quiet", "--python", python, str(folder)])
    found = folder / "bin/python"
    for some in _apart(wanted):
        ran([uv, "pip", "install", "--quiet", "--python", str(found), *some], more=settings)
    ran([uv, "pip", "check", "--quiet", "--python", str(found)])
    return found


def _apart(wanted: tuple[str, ...]) -> list[list[str]]:
    """Split off files of pins, since uv requires hashes for everything that it installs with
    them."""
    files = [["--require-hashes", "-r", one] for one in wanted if one.endswith(".txt")]
    others = [one for one in wanted if not one.endswith(".txt")]
    return [*files, others] if others else files
