"""Clients generated from the OpenAPI document start, follow and stop a grip.

A linter accepts the document. A standard EventSource follows a job to its end.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

from contrib.support.npm import node, npm_folder
from tests.support.adapters import FORCE_MN
from tests.support.checkout import ROOT
from tests.support.environments import environment, ran
from tests.support.running import RunningRig

DOCUMENT = ROOT / "deploy/openapi.json"
DRIVES = ROOT / "contrib/support/generated"
PYTHON = "openapi-python-client==0.29.1"
LINTER = "@redocly/cli@2.77.0"
TYPESCRIPT = ("openapi-typescript@7.13.0", "openapi-fetch@0.17.0", "typescript@5.9.3")
OPTIONAL = "--default-non-nullable=false"
"""A request may omit a field that has a default value."""
EVENTS = ROOT / "contrib/support/event_source.mjs"
EVENT_SOURCE = "eventsource@5.1.5"
SAMPLE = "B 7/8"


def test_a_generated_python_client_works(rig: RunningRig, tmp_path: Path) -> None:
    python = environment(tmp_path / "venv", PYTHON)
    script = str(python.with_name("openapi-python-client"))
    words = ("--path", str(DOCUMENT), "--meta", "none", "--output-path", "generated")
    ran([script, "generate", *words], tmp_path)
    done = expected(rig)
    line = [str(python), str(DRIVES / "drive.py"), rig.rig.supervisor.url, str(FORCE_MN), SAMPLE]
    assert said(ran(line, tmp_path)) == done


def expected(rig: RunningRig) -> dict[str, Any]:
    """Make a job with a sample; return what a client prints that fetches the table of such jobs."""
    rig.ended(rig.start_grip(sample=SAMPLE))
    table = rig.client.get("/jobs/export.parquet", params={"sample": SAMPLE}).content
    return {
        "state": "stopped",
        "same": {"samples.parquet": True, "grip.png": True},
        "export": hashlib.sha256(table).hexdigest(),
    }


def said(text: str) -> Any:
    return json.loads(text.splitlines()[-1])


def test_generated_typescript_types_are_correct(rig: RunningRig, tmp_path: Path) -> None:
    folder = npm_folder(tmp_path, DRIVES / "drive.mts", *TYPESCRIPT)
    for line in (
        ["openapi-typescript", str(DOCUMENT), "--output", "schema.d.ts", OPTIONAL],
        ["tsc", "--strict", "--skipLibCheck", "--module", "nodenext", "drive.mts"],
    ):
        ran(["npx", "--no-install", *line], folder)
    done = expected(rig)
    assert node(folder, "drive.mjs", rig.rig.supervisor.url, str(FORCE_MN), SAMPLE) == done


def test_a_standard_event_source_ends_with_the_job(rig: RunningRig, tmp_path: Path) -> None:
    folder = npm_folder(tmp_path, EVENTS, EVENT_SOURCE)
    job = rig.start_grip()
    found = node(folder, EVENTS.name, f"{rig.client.base_url}jobs/{job}/events")
    events = rig.get(f"/jobs/{job}/events/list")["events"]
    assert found == {"ids": [str(event["number"]) for event in events], "last": 204}


def test_a_linter_finds_nothing_in_the_document(tmp_path: Path) -> None:
    folder = npm_folder(tmp_path, DOCUMENT, LINTER)
    line = ["npx", "--no-install", "redocly", "lint", DOCUMENT.name]
    quiet = {"REDOCLY_TELEMETRY": "off", "REDOCLY_SUPPRESS_UPDATE_NOTICE": "true"}
    found = ran([*line, "--extends", "recommended", "--format", "json"], folder, quiet)
    assert json.loads(found)["totals"] == {"errors": 0, "warnings": 0, "ignored": 0}, found
