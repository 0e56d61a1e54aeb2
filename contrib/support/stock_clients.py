"""Runs the documents' programs for stock clients of the adapters on the host."""

import re
import subprocess
import sys

from tests.support.checkout import ROOT, environment
from tests.support.documents import Block, blocks_of

HELD = r"held with 1[45]\.\d\d mN"


def block(page: str, first: str) -> Block:
    """Return the block of a page that contains some words."""
    (found,) = (one for one in blocks_of(ROOT / page) if first in one.text)
    return found


def on_the_host(block: Block) -> str:
    """Return the output of a page's program, run on the host with the stock client."""
    done = subprocess.run(
        [sys.executable, "-c", block.text],
        cwd=ROOT,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=90.0,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def grip_by_sila() -> None:
    """Grip and release by the stock client of SiLA; raises AssertionError."""
    output = on_the_host(block("docs/how-to/sila.md", "from sila2.client import"))
    assert re.search(HELD, output), output
    assert output.endswith("released\n")
