"""A help text loads no library that it does not need, since its time is that of its imports."""

import json
import subprocess
import sys

import pytest

from pincette.cli.main import COMMANDS

NEVER = (
    "matplotlib",
    "zenoh",
    "httpx",
    "pyarrow",
    "numpy",
    "fastapi",
    "sqlalchemy",
    "rich.progress",
    "pincette.config.rig_file",
    "pincette.client",
    "pincette.engine.process",
)
"""Libraries that cost a tenth of a second of processor time or more, some of them a whole one."""
MOST = 700
"""Largest number of modules; a bare command line has 230, one with the models of a request 480."""
ALLOWED = {"init": {"pincette.config.rig_file"}}
"""Exceptions; the prompts are the tables of a rig file."""
SHOW = """
import contextlib, io, json, sys
from pincette.cli.main import main
with contextlib.redirect_stdout(io.StringIO()):
    main(sys.argv[1:])
print(json.dumps(sorted(sys.modules)))
"""


def modules(*words: str) -> set[str]:
    """Return the modules that a process has loaded after showing a help text."""
    line = [sys.executable, "-c", SHOW, *words, "--help"]
    ran = subprocess.run(line, capture_output=True, text=True, check=True, timeout=60.0)
    return set(json.loads(ran.stdout))


@pytest.mark.parametrize("words", [(name,) for name in COMMANDS] + [("job", "grip"), ("grip",)])
def test_a_help_text_imports_only_what_it_needs(words: tuple[str, ...]) -> None:
    loaded = modules(*words)
    allowed = ALLOWED.get(words[0], set())
    assert [name for name in NEVER if name in loaded and name not in allowed] == []
    assert len(loaded) <= MOST


@pytest.mark.parametrize("words", [("rigs",), ("job", "list")], ids=" ".join)
def test_a_request_to_a_supervisor_does_not_import_httpx_command_line(
    words: tuple[str, ...],
) -> None:
    line = [sys.executable, "-c", SHOW, *words, "--url", "http://127.0.0.1:9"]
    ran = subprocess.run(line, capture_output=True, text=True, check=True, timeout=60.0)
    loaded = set(json.loads(ran.stdout))
    assert "httpx" in loaded
    assert [name for name in ("rich.progress", "pygments") if name in loaded] == []
