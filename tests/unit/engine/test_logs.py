"""Log lines of programs, in JSON."""

import json
import logging
import os
import subprocess
import sys
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from pincette.engine.logs import VARIABLE, JsonLines, chosen

ROOT = Path(__file__).parents[3]
SAYS = """
import logging, warnings
from pincette.engine.logs import begin
lines = begin("sensor", "json")
lines.rig = "demo"
logging.getLogger("a.b").warning("%s is late", "sample 7", extra={"job": "j-1", "seq": 7})
logging.getLogger("uvicorn.error").error("no port")
warnings.warn("old", DeprecationWarning)
logging.getLogger("quiet").debug("not said")
try:
    raise OSError("gone")
except OSError:
    logging.getLogger("c").exception("a\\nb")
"""


def said() -> list[dict[str, Any]]:
    ran = subprocess.run(
        [sys.executable, "-W", "always", "-c", SAYS],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    return [json.loads(line) for line in ran.stderr.splitlines()]


def test_every_line_is_an_object_with_time_program_and_source() -> None:
    late, port, old, gone = said()
    assert late["message"] == "sample 7 is late"
    assert (late["level"], late["program"], late["rig"]) == ("warning", "sensor", "demo")
    assert (late["job"], late["seq"], late["logger"]) == ("j-1", 7, "a.b")
    assert datetime.fromisoformat(late["time"]).utcoffset() == timedelta(0)
    assert late["time"].endswith("Z")
    assert (port["logger"], port["message"]) == ("uvicorn.error", "no port")
    assert "job" not in port
    assert "old" in old["message"]
    assert gone["message"] == "a\nb"
    assert "OSError: gone" in gone["error"]


def test_fields_of_a_caller_do_not_replace_fields_of_a_log_line() -> None:
    given = {"msg": "x", "levelname": "INFO", "program": "other", "place": Path()}
    record = logging.makeLogRecord(given)
    line = json.loads(JsonLines("rig").format(record))
    assert (line["program"], line["level"], line["place"]) == ("rig", "info", ".")
    assert "rig" not in line


def test_the_command_line_takes_precedence_over_the_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert chosen(None) == "text"
    monkeypatch.setenv(VARIABLE, "json")
    assert (chosen(None), chosen("text")) == ("json", "text")
    monkeypatch.setenv(VARIABLE, "xml")
    with pytest.raises(ValueError, match="expected text or json"):
        chosen(None)


def test_a_program_that_cannot_start_reports_it_as_json(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pincette", "run", "sensor", "--log-format", "json"]
    ran = subprocess.run(
        [*command, "--rig", str(tmp_path / "none.toml")],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ},
        cwd=ROOT,
    )
    (line,) = (json.loads(line) for line in ran.stderr.splitlines())
    assert ran.returncode == 2
    assert (line["level"], line["program"]) == ("error", "sensor")
    assert "none.toml" in line["message"]
