"""The list of tests that `make test` leaves out: every line names an existing test, and a time
limit ends the run."""

import subprocess
import sys
from pathlib import Path

from tests.support.selection import rank, ranks


def test_every_line_names_a_test_once(root: Path) -> None:
    gone: list[str] = []
    known = ranks()
    for line in known:
        file, _, test = line.partition("::")
        name = test.partition("[")[0].rpartition("::")[2]
        if not (root / file).is_file() or f"def {name}" not in (root / file).read_text("utf-8"):
            gone.append(line)
    assert gone == []
    names = list(known)
    twice = [one for one in names if any(one.startswith(f"{other}:") for other in names)]
    assert twice == []


def test_a_line_is_a_file_a_test_or_a_case() -> None:
    known = {"a.py": 1, "b.py::test_b": 2, "c.py::test_c[x]": 3}
    found = [
        rank(name, known)
        for name in ("a.py::test_any", "b.py::test_b[y]", "b.py::test_by", "c.py::test_c[x]")
    ]
    assert found == [1, 2, -1, 3]
    assert rank("c.py::test_c[y]", known) == -1


def test_tests_that_have_not_started_in_time_are_skipped_and_named(root: Path) -> None:
    test = "tests/project/test_full_list.py::test_a_line_is_a_file_a_test_or_a_case"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--until", "1", test],
        cwd=root,
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert "1 tests left out: the time of the session is used up" in done.stdout
    assert "tests/project/test_full_list.py: 1" in done.stdout
    assert "1 skipped" in done.stdout
