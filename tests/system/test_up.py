"""`pincette up` begins and ends: one line a program, and nothing that outlives it."""

import re
import signal
from pathlib import Path

import pytest

from pincette.core.topics import LOOP
from tests.support.checkout import await_text, until_interrupted
from tests.support.commands import PINCETTE, assert_nothing_is_left, processes_of
from tests.support.rigs import demo_rig, rig_toml

pytestmark = pytest.mark.usefixtures("stalls")

PROGRAMS = {"recorder", "router", "rig", *LOOP, "supervisor"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_outlives_it(tmp_path: Path, number: signal.Signals) -> None:
    rig, path, log = demo_rig(), tmp_path / "rig.toml", tmp_path / "up.log"
    path.write_text(rig_toml(rig), encoding="utf-8")
    command = [*PINCETTE, "up", "--rig", str(path), "--data", str(tmp_path / "data")]
    with until_interrupted(command, tmp_path, log) as process:
        said = await_text(log, "is up at", process, 60.0)
        shown = dict(re.findall(r"^● (\w+) +(\d+) ", said, re.MULTILINE))
        assert shown.keys() == PROGRAMS
        assert {int(one) for one in shown.values()} <= processes_of(path).keys()
        assert max(len(line) for line in said.splitlines()) <= 80
        process.send_signal(number)
        status = process.wait(20.0)
    assert status == (-signal.SIGKILL if number == signal.SIGKILL else 0)
    # Killed, it cannot end the others; they end because their standard input has closed.
    assert_nothing_is_left(rig, path, timeout_s=10.0)
