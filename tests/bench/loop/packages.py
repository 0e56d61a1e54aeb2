"""The packages that only the rings need, in a separate environment."""

import sys
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.support.checkout import ROOT
from tests.support.environments import environment

PINS = ROOT / "requirements" / "rings.txt"
PACKAGES = ("zeromq", "cyclonedds")
"""Rings of these packages; see ``tests.bench.others``."""


def folder_of_packages() -> Path:
    """Return the folder with these packages; an environment is made once for each list of pinned
    versions."""
    made = Path(sys.prefix) / f"rings-{sha256(PINS.read_bytes()).hexdigest()[:12]}"
    if not made.exists():
        with TemporaryDirectory(dir=sys.prefix) as folder:
            environment(Path(folder) / "made", str(PINS)).parents[1].rename(made)
    (packages,) = made.glob("lib/python*/site-packages")
    return packages
