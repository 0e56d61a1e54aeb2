"""The changelog states the versions of the interfaces and of the newest release."""

import re
from pathlib import Path
from typing import Any

import pytest

from pincette.api import BASE
from pincette.core.topics import ROOT as WIRE_ROOT

HEAD = re.compile(r"^## \[(\d+\.\d+\.\d+|Unreleased)\](?: - (\d{4}-\d{2}-\d{2}|not yet))?$", re.M)
PARTS = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security", "Interfaces"}
ROW = re.compile(r"^\| (REST|keys and messages) \| (v\d+) \|$", re.M)


@pytest.fixture(scope="module")
def changelog(root: Path) -> str:
    return (root / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_newest_section_states_the_version_of_each_interface(changelog: str) -> None:
    newest = re.split(r"^## ", changelog, flags=re.MULTILINE)[1]
    assert dict(ROW.findall(newest)) == {
        "REST": BASE.rpartition("/")[2],
        "keys and messages": WIRE_ROOT.rpartition("/")[2],
    }


def test_the_headings_are_those_of_a_changelog(changelog: str, pyproject: dict[str, Any]) -> None:
    heads = [found[0] for found in HEAD.findall(changelog)]
    assert len(heads) == len(re.findall(r"^## ", changelog, re.MULTILINE))
    released = [head for head in heads if head != "Unreleased"]
    assert released[0] == pyproject["project"]["version"]
    numbers = [tuple(map(int, head.split("."))) for head in released]
    assert numbers == sorted(set(numbers), reverse=True)
    assert set(re.findall(r"^### (.*)$", changelog, re.MULTILINE)) <= PARTS
