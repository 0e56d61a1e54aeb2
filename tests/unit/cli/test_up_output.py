"""Output of ``pincette up`` that cannot be written does not end the rig."""

import os
import subprocess
import sys
from collections.abc import Callable

import pytest

PROGRAM = """
import os, sys
from pincette.cli import up
from pincette.cli.terminal import screen
console = screen()
for _ in range(3):
    up._print(console, "rig demo is up", markup=False)
sys.stderr.write("still up")
sys.stderr.flush()
os._exit(0)
"""


def _closed_pipe() -> int:
    reader, writer = os.pipe()
    os.close(reader)
    return writer


def _full_disk() -> int:
    return os.open("/dev/full", os.O_WRONLY)


@pytest.mark.parametrize("made", [_closed_pipe, _full_disk])
def test_a_rig_stays_up_where_its_output_cannot_be_written(made: Callable[[], int]) -> None:
    output = made()
    try:
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM],
            stdout=output,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            timeout=60,
        )
    finally:
        os.close(output)
    assert done.stderr == "still up"
