"""Which failures in real-time tests are rerun once, and which count."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.checkout import ROOT
from tests.support.reruns import LIMIT

CONFTEST = """\
from time import monotonic, sleep

import pytest
from helpers import stall

from tests.support.stalls import StallRecorder, Usage

pytest_plugins = ["tests.support.reruns"]


@pytest.fixture(autouse=True)
def others(monkeypatch):
    used = lambda: Usage({elsewhere} * monotonic(), 0.0)
    monkeypatch.setattr("tests.support.reruns.usage", used)


def pytest_configure():
    # What this machine does to this test itself is left out.
    StallRecorder._beat = lambda *_: None


@pytest.fixture(scope="module")
def rig(request):
    request.module.MADE.append(None)
    yield len(request.module.MADE)
    print("taken down")
"""
HELPERS = """\
from time import monotonic


def stall(recorder, length_s=0.05):
    recorder.stalls.append((monotonic() - length_s, length_s))


def wait(recorder, length_s=0.05):
    recorder.waits.append((monotonic() - length_s, length_s))
"""
TEST = """\
from time import sleep

import pytest

from helpers import stall, wait

MADE = []


def measuring(stalls, measured):
    # A race that is lost each odd time.
    with measured():
        sleep(0.06)
        {within}
        assert len(MADE) % 2 == 0, "lost"


{mark}
def test_it(stalls, rig, measured{asks}):
    print("made", rig)
    {before}
    measuring(stalls, measured)
"""
OPTIONS = ("-p", "no:cacheprovider", "-c", str(ROOT / "pyproject.toml"), "-s")


def ran(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "pytest", *OPTIONS, "--rootdir", str(folder), *words, str(folder)],
        cwd=ROOT,
        env={"PYTHONPATH": f"{folder}", "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )


def write(
    folder: Path,
    *names: str,
    before: str = "pass",
    within: str = "pass",
    mark: str = "",
    asks: str = "",
    elsewhere: float = 0.0,
) -> None:
    """Write a file for each name, with a test that loses a race in every odd run.

    ``elsewhere`` is the share of a processor that other programs use.
    """
    (folder / "helpers.py").write_text(HELPERS, encoding="utf-8")
    (folder / "conftest.py").write_text(
        CONFTEST.replace("{elsewhere}", str(elsewhere)), encoding="utf-8"
    )
    text = TEST.format(before=before, within=within, mark=mark, asks=asks)
    for name in names:
        (folder / f"test_{name}.py").write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("before", "within"),
    [
        ("pass", "pass"),
        ("stall(stalls); sleep(0.2)", "pass"),
        ("pass", "stall(stalls, 0.004)"),
        ("pass", "wait(stalls)"),
    ],
    ids=["no stall", "before the window", "a short one", "a wait for the test's own programs"],
)
def test_a_failure_without_a_stall_in_its_window_counts(
    tmp_path: Path, before: str, within: str
) -> None:
    write(tmp_path, "one", before=before, within=within)
    done = ran(tmp_path)
    assert done.returncode == 1, done.stdout
    assert "AssertionError: lost" in done.stdout
    assert "1 failed" in done.stdout
    assert done.stdout.count("made ") == done.stdout.count("taken down") == 1


@pytest.mark.parametrize(
    ("within", "elsewhere"),
    [("stall(stalls)", 0.0), ("wait(stalls)", 1.0)],
    ids=["taken away", "used by programs of others"],
)
def test_a_failure_with_a_stall_in_its_window_is_rerun_once(
    tmp_path: Path, within: str, elsewhere: float
) -> None:
    write(tmp_path, "one", within=within, elsewhere=elsewhere)
    done = ran(tmp_path)
    assert done.returncode == 0, done.stdout
    assert "1 passed, 1 rerun" in done.stdout
    assert "test_one.py::test_it: 50 ms: AssertionError: lost" in done.stdout
    assert done.stdout.count("made ") == done.stdout.count("taken down") == 2


def test_a_test_is_not_rerun_twice(tmp_path: Path) -> None:
    write(tmp_path, "one", within="stall(stalls); assert not MADE")
    done = ran(tmp_path)
    assert done.returncode == 1, done.stdout
    assert "1 failed, 1 rerun" in done.stdout
    assert done.stdout.count("made ") == 2


@pytest.mark.parametrize("workers", [(), ("-n", "2")], ids=["one process", "two workers"])
def test_a_session_has_a_limited_number_of_reruns(tmp_path: Path, workers: tuple[str, ...]) -> None:
    write(tmp_path, "a", "b", "c", "d", within="stall(stalls)")
    done = ran(tmp_path, *workers)
    assert done.returncode == 1, done.stdout
    assert f"1 failed, {LIMIT} passed, {LIMIT} rerun" in done.stdout


def test_a_failure_of_a_fixture_is_rerun_if_a_stall_occurred_during_its_setup(
    tmp_path: Path,
) -> None:
    write(tmp_path, "one", mark='@pytest.mark.usefixtures("weak")')
    with (tmp_path / "conftest.py").open("a", encoding="utf-8") as conftest:
        conftest.write(
            "\n\n@pytest.fixture\ndef weak(stalls, rig):\n"
            "    sleep(0.06)\n    stall(stalls)\n    assert rig == 2\n"
        )
    done = ran(tmp_path)
    assert done.returncode == 0, done.stdout
    assert "1 passed, 1 rerun" in done.stdout


@pytest.mark.parametrize("fixture", ["browser", "readme"])
def test_a_browser_or_the_readme_is_never_rerun(tmp_path: Path, fixture: str) -> None:
    write(tmp_path, "one", within="stall(stalls)", asks=f", {fixture}")
    with (tmp_path / "conftest.py").open("a", encoding="utf-8") as conftest:
        conftest.write(f"\n\n@pytest.fixture\ndef {fixture}():\n    return None\n")
    done = ran(tmp_path)
    assert done.returncode == 1, done.stdout
    assert "AssertionError: lost" in done.stdout
    assert "1 failed" in done.stdout
    assert done.stdout.count("made ") == 1
