"""Stock clients in JavaScript from npm's registry, each in its own folder."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

LONG_S = 300.0
NODE_WOT = (
    "@node-wot/core@0.9.2",
    "@node-wot/binding-http@0.9.2",
    # By default npm uses the JSON schema of 2021, which sorts month names as words.
    "wot-thing-description-types@1.1.0-12-March-2025",
)
DRIVE = Path(__file__).parent / "node_wot/drive.js"
"""Script that drives a rig by its Thing Description."""
HOLD = DRIVE.with_name("hold.js")
"""Script that drives a rig by its Thing Description from successive processes."""


def npm_folder(folder: Path, script: Path, *packages: str) -> Path:
    """Return a folder with some packages and a script; skips if npm cannot install them."""
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        pytest.skip(f"node and npm are missing: {script.name} is not run")
    line = [npm, "install", "--prefix", str(folder), "--no-audit", "--no-fund", *packages]
    done = subprocess.run(line, capture_output=True, text=True, timeout=LONG_S, check=False)
    if done.returncode:
        pytest.skip(f"npm cannot install {packages[0]}: {done.stderr.strip()[-300:]}")
    shutil.copy(script, folder)
    return folder


def node(folder: Path, script: str, *words: str, **more: str) -> dict[str, Any]:
    """Return the JSON that a script prints last."""
    done = subprocess.run(
        ["node", script, *words],
        cwd=folder,
        env={**os.environ, **more},
        capture_output=True,
        text=True,
        timeout=LONG_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
