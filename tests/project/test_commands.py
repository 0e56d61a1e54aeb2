"""README, Makefile and CI name the same commands."""

import re
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def targets(root: Path) -> set[str]:
    makefile = (root / "Makefile").read_text(encoding="utf-8")
    return set(re.findall(r"^([a-z]+):", makefile, re.MULTILINE))


def test_every_command_of_the_documents_exists(files: list[Path], targets: set[str]) -> None:
    named = {
        target
        for path in files
        if path.suffix == ".md"
        for target in re.findall(
            r"(?:`|^\s*\$? *)make ([a-z]+)", path.read_text(encoding="utf-8"), re.MULTILINE
        )
    }
    assert named
    assert named <= targets


def test_ci_runs_the_test_command_of_the_readme(root: Path) -> None:
    readme = (root / "README.md").read_text(encoding="utf-8")
    assert re.search(r"\bmake test\b", readme), "README.md does not name its test command"
    script = root / ".ci/run"
    assert "\ncommand=(make test)\n" in script.read_text(encoding="utf-8")
    assert script.stat().st_mode & 0o111
