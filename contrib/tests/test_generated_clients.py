"""Clients that stock generators make of the OpenAPI document start, follow and stop a grip."""

import json
import subprocess
from pathlib import Path
from typing import Any

from contrib.support.npm import LONG_S, node, npm_folder
from tests.support.adapters import FORCE_MN
from tests.support.checkout import ROOT
from tests.support.environments import environment, ran
from tests.support.running import RunningRig

DOCUMENT = ROOT / "deploy/openapi.json"
DRIVES = ROOT / "contrib/support/generated"
PYTHON = "openapi-python-client==0.29.1"
TYPESCRIPT = ("openapi-typescript@7.13.0", "openapi-fetch@0.17.0", "typescript@5.9.3")
OPTIONAL = "--default-non-nullable=false"
"""A field with a default may be left out of a request."""
DONE = {
    "state": "stopped",
    "same": {"samples.parquet": True, "grip.png": True, "export": True},
}


def test_a_generated_client_in_python(rig: RunningRig, tmp_path: Path) -> None:
    python = environment(tmp_path / "venv", PYTHON)
    script = str(python.with_name("openapi-python-client"))
    words = ("--path", str(DOCUMENT), "--meta", "none", "--output-path", "generated")
    ran([script, "generate", *words], tmp_path)
    line = [str(python), str(DRIVES / "drive.py"), rig.rig.supervisor.url, str(FORCE_MN)]
    assert said(ran(line, tmp_path)) == DONE


def said(text: str) -> Any:
    return json.loads(text.splitlines()[-1])


def test_generated_types_in_typescript(rig: RunningRig, tmp_path: Path) -> None:
    folder = npm_folder(tmp_path, DRIVES / "drive.mts", *TYPESCRIPT)
    for line in (
        ["openapi-typescript", str(DOCUMENT), "--output", "schema.d.ts", OPTIONAL],
        ["tsc", "--strict", "--skipLibCheck", "--module", "nodenext", "drive.mts"],
    ):
        done = subprocess.run(
            ["npx", "--no-install", *line],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=LONG_S,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
    assert node(folder, "drive.mjs", rig.rig.supervisor.url, str(FORCE_MN)) == DONE
