"""``pincette estop`` loads what a stop needs and nothing else, so that it starts at once."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.answering import answering, stopped
from tests.support.rigs import demo_rig, rig_toml

NEVER = (
    "typer",
    "rich",
    "pydantic",
    "httpx",
    "numpy",
    "cryptography",
    "asyncio",
    "fastapi",
    "sqlalchemy",
    "pincette.api",
    "pincette.client",
    "pincette.config.rig_file",
    "pincette.engine",
    "pincette.sim",
)
SCRIPT = """
import sys
from pincette.__main__ import main
main(["estop", *sys.argv[1:]])
print("loaded", *sorted(sys.modules))
"""


@pytest.mark.parametrize("has_file", [True, False])
def test_a_stop_loads_nothing_that_it_does_not_need(has_file: bool, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    if has_file:
        rig.write_text(rig_toml(demo_rig()), encoding="utf-8")
    with answering(200, stopped("demo")) as supervisor:
        words = [sys.executable, "-c", SCRIPT, "--url", supervisor.url, "--rig", str(rig)]
        ran = subprocess.run(words, capture_output=True, text=True, check=True, timeout=60.0)
    loaded = set(ran.stdout.splitlines()[-1].split())
    assert "pincette.cli.estop" in loaded
    assert [name for name in NEVER if name in loaded] == []
