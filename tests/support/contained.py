"""Which programs have a container, and what a stock client says on the host of an adapter's."""

import re
import subprocess
import sys

from pincette.core.service import programs
from tests.support.checkout import ROOT, environment
from tests.support.documents import Block, typed_blocks

BEYOND = ("foxglove", "sila", "upstream")
"""Programs of extras, which have a profile, and one of another host."""
PROFILES = {"sila": 50052, "foxglove": 8765, "madsci": 2000}
"""Servers that a profile of docker-compose.yml adds, and the port of each on the host."""
HELD = r"held with 1[45]\.\d\d mN"


def contained() -> list[str]:
    """Programs that docker-compose.yml runs, by name."""
    return [name for name in programs() if name not in BEYOND]


def block(page: str, first: str) -> Block:
    """The program of a page that has some words."""
    (found,) = (one for one in typed_blocks(page) if first in one.text)
    return found


def on_the_host(block: Block) -> str:
    """What a program of a page says, run on the host with the stock client."""
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
    """The stock client of SiLA grips and releases; raises AssertionError."""
    said = on_the_host(block("docs/how-to/sila.md", "from sila2.client import"))
    assert re.search(HELD, said), said
    assert said.endswith("released\n")
