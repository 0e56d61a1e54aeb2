"""The image `pincette-adapters` contains the imports of its programs, and every package they
need."""

import re
import subprocess
import sys

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.project.test_images import IMPORTED, NOT_OURS
from tests.support.checkout import ROOT

PROGRAMS = ("pincette_sila.program", "pincette_foxglove.program", "pincette_mcp.server")
PACKAGES = ("foxglove", "mcp", "sila")
"""Packages of contrib that are installed in the image."""


def test_the_adapters_install_the_packages_that_their_programs_import() -> None:
    line = [sys.executable, "-c", IMPORTED, "pincette.__main__", "pincette.engine.program"]
    done = subprocess.run(
        [*line, *PROGRAMS], capture_output=True, text=True, timeout=120.0, check=True
    )
    ours = NOT_OURS | {f"pincette-{name}" for name in PACKAGES}
    imported = {canonicalize_name(name) for name in done.stdout.split()} - ours
    pins = (ROOT / "requirements/adapters.txt").read_text(encoding="utf-8").splitlines()
    held = {
        canonicalize_name(Requirement(line.rstrip(" \\")).name) for line in pins if "==" in line
    }
    # httpx and the command line use these packages only if they are installed.
    assert imported - held <= {"pygments", "rich", "zstandard"}


def test_the_image_builds_the_packages_of_its_programs() -> None:
    dockerfile = (ROOT / "deploy/Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    (built,) = re.findall(r"--wheel-dir /adapters ((?: *\./contrib/\w+)+)", dockerfile)
    assert built.split() == [f"./contrib/{name}" for name in PACKAGES]
