"""The screen of ``up`` and ``demo``: output that cannot be written ends no rig."""

import os
import subprocess
import sys
from collections.abc import Callable

import pytest

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
def test_every_encoding_will_do(encoding: str) -> None:
    reader, writer = os.pipe()
    said = _said(writer, PYTHONIOENCODING=f"{encoding}:strict", LC_ALL="C")
    assert said == "still up\n"
    shown = os.read(reader, 4096).decode(encoding)
    assert shown.count("rig [/demo] is up\n") == 3
    os.close(reader)
