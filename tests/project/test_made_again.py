"""What ``tests/conftest.py`` makes again, and what it lets stand."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.checkout import ROOT
from tests.support.stalls import TRIES

CONFTEST = """\
from time import monotonic

import pytest

from tests.conftest import *
from tests.support.stalls import StallRecorder


@pytest.fixture(scope="module")
def stalls(request):
    stood_s = request.module.STOOD_S
    return StallRecorder([(monotonic(), stood_s)] if stood_s else [])
"""
TEST = """\
import itertools

import pytest

STOOD_S = {stood_s}
COUNT = itertools.count(1)


@pytest.fixture(scope="module")
def rig():
    yield next(COUNT)
    print("taken down")


def test_it({stalls}rig):
    print("made", rig)
    assert rig >= {works_at}
"""


@pytest.mark.parametrize(
    ("stood_s", "works_at", "asks", "made", "passes"),
    [
        (0.006, 2, True, 2, True),
        (0.006, 99, True, TRIES, False),
        (0.004, 2, True, 1, False),
        (0.0, 2, True, 1, False),
        (0.006, 2, False, 1, False),
    ],
    ids=["again", "not for ever", "short stalls", "no stall", "keeps no clock"],
)
def test_a_failure_is_made_again_where_the_machine_stood_still(
    tmp_path: Path, stood_s: float, works_at: int, asks: bool, made: int, passes: bool
) -> None:
    (tmp_path / "conftest.py").write_text(CONFTEST, encoding="utf-8")
    text = TEST.format(stood_s=stood_s, works_at=works_at, stalls="stalls, " if asks else "")
    (tmp_path / "test_one.py").write_text(text, encoding="utf-8")
    options = ["-c", str(ROOT / "pyproject.toml"), "--rootdir", str(tmp_path), "-s"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *options, str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert done.stdout.count("made ") - done.stdout.count("made again") == made, done.stdout
    assert done.stdout.count("taken down") == made, done.stdout
    assert (done.returncode == 0) is passes, done.stdout
    assert ("made again, since the machine stood still" in done.stdout) is (made > 1)
    assert f"{int(passes)} passed" in done.stdout or "1 failed" in done.stdout
