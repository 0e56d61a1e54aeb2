"""The second arm is calibrated as in its tutorial, in lockstep, and then grips the part."""

import re
from collections.abc import Generator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.support.checkout import await_text, demo_ports, run, until_interrupted, workspace
from tests.support.documents import typed_blocks
from tests.support.rigs import DEMO

PAGE, RIG = "docs/tutorials/two-arms.md", "deploy/rigs/two-arms.toml"
UP_S, TYPED_S = 90.0, 300.0


@pytest.fixture
def checkout(tmp_path: Path) -> Generator[Path]:
    """Make a checkout whose rigs are in lockstep, as fast as the machine allows."""
    place = workspace(tmp_path / "pincette")
    (place / "data").mkdir()
    demo = place / "deploy/rigs" / DEMO.name
    paced = demo.read_text(encoding="utf-8")
    assert paced.count("pace = 1.0\n") == 1
    demo.write_text(paced.replace("pace = 1.0\n", ""), encoding="utf-8")
    with demo_ports():
        yield place


def test_the_second_arm_is_taught_accepted_and_grips_with_the_first(checkout: Path) -> None:
    (block,) = (block for block in typed_blocks(PAGE) if "calibrate free_response" in block.text)
    with ExitStack() as stack:
        log = checkout / "up.log"
        words = [".venv/bin/pincette", "up", "--rig", RIG]
        process = stack.enter_context(until_interrupted(words, checkout, log))
        await_text(log, "is up at http://127.0.0.1:8000", process, UP_S)
        done = run(["bash", "-euc", f"PATH=.venv/bin:$PATH\n{block.text}"], checkout, TYPED_S)
    assert done.returncode == 0, done.stdout
    assert re.search(r"second\.model\.piezo_um_per_V", done.stdout), done.stdout
    assert re.search(r"succeeded: gripped", done.stdout), done.stdout
