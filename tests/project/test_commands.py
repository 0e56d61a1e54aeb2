"""README, Makefile and CI name the same commands; documents use existing commands and options."""

import re
import runpy
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.support.command_line import is_known

COMMAND = re.compile(r"^ *(?:\.venv/bin/)?pincette ((?:[a-z].*))$|`pincette ([a-z][^`\n]*)`", re.M)
PLACES = {"N": "1", "VERSION": "1"}


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


def test_the_command_line_page_is_up_to_date(root: Path) -> None:
    generator: dict[str, Any] = runpy.run_path(str(root / "docs/generate_cli.py"))
    page = (root / "docs/reference/cli.md").read_text(encoding="utf-8")
    assert page == generator["page"](), "run `python docs/generate_cli.py`, look at the difference"


def of_contrib(root: Path) -> set[tuple[str, ...]]:
    """Return the first words of the commands that packages of contrib add."""
    found: set[tuple[str, ...]] = set()
    for path in root.glob("contrib/*/pyproject.toml"):
        points = tomllib.loads(path.read_text("utf-8"))["project"].get("entry-points", {})
        found |= {(name,) for name in points.get("pincette.commands", {})}
        found |= {("run", name) for name in points.get("pincette.programs", {})}
    return found


def test_every_option_in_the_documents_exists(files: list[Path], root: Path) -> None:
    added = of_contrib(root)
    assert added
    read = 0
    unknown: list[str] = []
    for path in files:
        if path.suffix != ".md" or path.name == "cli.md":
            continue
        for one, other in COMMAND.findall(path.read_text(encoding="utf-8")):
            line = (one or other).partition(" #")[0]
            words = [PLACES.get(word, word) for word in shlex.split(line)]
            if {"...", "…", "NAME", "COMMAND", "KIND"} & set(words):
                continue
            read += 1
            if {tuple(words[:1]), tuple(words[:2])} & added:
                continue
            if not is_known(words):
                unknown.append(f"{path.name}: pincette {line}")
    assert unknown == []
    assert read > 20
