"""The screen of ``up`` and ``demo``: output that cannot be written ends no rig."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from pincette.cli import up
from pincette.engine.fleet import Child, Fleet

PROGRAM = """
import sys
from pincette.cli import CliError, up
from pincette.cli.terminal import lasting_screen
from pincette.core.streams import prepare_streams
prepare_streams()
try:
    with lasting_screen() as console:
        for _ in range(3):
            up._print(console, "● rig [/demo] is up")
        sys.stderr.write("still up\\n")
except CliError as error:
    sys.stderr.write(str(error))
"""


def _ended_pipe() -> int:
    reader, writer = os.pipe()
    os.close(reader)
    return writer


def _full_disk() -> int:
    return os.open("/dev/full", os.O_WRONLY)


def _said(output: int, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        stdout=output,
        stderr=subprocess.PIPE,
        env={**os.environ, **environment},
        text=True,
        check=False,
        timeout=60,
    )
    os.close(output)
    return done.stderr


@pytest.mark.parametrize("made", [_ended_pipe, _full_disk])
def test_lines_that_cannot_be_written_are_counted_at_the_end(made: Callable[[], int]) -> None:
    assert _said(made()).splitlines()[0] == "still up"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_every_encoding_is_accepted(encoding: str) -> None:
    reader, writer = os.pipe()
    output = _said(writer, PYTHONIOENCODING=f"{encoding}:strict", LC_ALL="C")
    assert output == "still up\n"
    shown = os.read(reader, 4096).decode(encoding)
    assert shown.count("rig [/demo] is up\n") == 3
    os.close(reader)


class Process:
    """Replaces a process of the operating system."""

    def __init__(self, pid: int) -> None:
        self.pid = pid

    def poll(self) -> None:
        """Return that it runs."""


def test_the_log_of_a_restarted_program_that_does_not_serve_is_shown(tmp_path: Path) -> None:
    log = tmp_path / "supervisor.log"
    log.write_text("2026-01-01 10:00:00,000 supervisor 127.0.0.1:8000 is in use\n")
    member = Child("supervisor", cast("subprocess.Popen[str]", Process(1)), log)
    fleet = cast("Fleet", SimpleNamespace(members={"supervisor": member}))
    now_s, stated = [0.0], list[tuple[str, str]]()
    restarts = up.Restarts(fleet, lambda: now_s[0])

    def lines_after(duration_s: float) -> list[tuple[str, str]]:
        now_s[0] += duration_s
        stated.clear()
        restarts.show(lambda _member, tone, line: stated.append((tone, line)))
        return list(stated)

    assert lines_after(100.0) == []
    member.process = cast("subprocess.Popen[str]", Process(2))
    assert lines_after(1.0) == []
    ((tone, line),) = lines_after(up.FIRST_NEWS_S)
    assert tone == "yellow"
    assert line.endswith("127.0.0.1:8000 is in use")
    assert lines_after(2.0 * up.NEWS_S) == []
    log.write_text("2026-01-01 10:00:20,000 supervisor the journal is damaged\n")
    assert len(lines_after(0.1)) == 1
    member.line = "serves"
    member.ready.set()
    assert lines_after(0.1) == [("green", "serves")]
    assert lines_after(100.0) == []
