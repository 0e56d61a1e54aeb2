"""The changelog states each interface as it is, and the version that is released."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.support.interfaces import VERSIONS, complaint, digest, digests, stated

HEAD = re.compile(r"^## \[(\d+\.\d+\.\d+|Unreleased)\](?: - (\d{4}-\d{2}-\d{2}|not yet))?$", re.M)
PARTS = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security", "Interfaces"}


@pytest.fixture(scope="module")
def changelog(root: Path) -> str:
    return (root / "CHANGELOG.md").read_text(encoding="utf-8")


def test_no_interface_changes_without_a_line(changelog: str) -> None:
    said = stated(changelog)
    words = [
        complaint(name, said.get(name), VERSIONS[name], now) for name, now in digests().items()
    ]
    assert [word for word in words if word] == []
    assert said.keys() == VERSIONS.keys()


def test_its_parts_are_those_of_a_changelog(changelog: str, pyproject: dict[str, Any]) -> None:
    heads = [found[0] for found in HEAD.findall(changelog)]
    assert len(heads) == len(re.findall(r"^## ", changelog, re.MULTILINE))
    released = [head for head in heads if head != "Unreleased"]
    assert released[0] == pyproject["project"]["version"]
    numbers = [tuple(map(int, head.split("."))) for head in released]
    assert numbers == sorted(set(numbers), reverse=True)
    assert set(re.findall(r"^### (.*)$", changelog, re.MULTILINE)) <= PARTS


@pytest.mark.parametrize("document", ["openapi", "asyncapi"])
def test_words_and_order_change_no_digest_and_all_else_does(root: Path, document: str) -> None:
    tree: dict[str, Any] = json.loads((root / f"deploy/{document}.json").read_text("utf-8"))
    before = digest(tree)
    schemas: dict[str, Any] = tree["components"]["schemas"]
    name, schema = next((name, one) for name, one in schemas.items() if one.get("properties"))
    schema["description"] = "other words"
    tree["components"]["schemas"] = dict(reversed(schemas.items()))
    assert digest(tree) == before
    schema["properties"]["title"] = {"type": "string"}
    with_a_member = digest(tree)
    assert with_a_member != before
    schema["properties"]["title"] = {"type": "number"}
    assert digest(tree) not in (before, with_a_member)
    del tree["components"]["schemas"][name]
    assert digest(tree) != before


def test_a_change_is_told_with_what_to_do() -> None:
    assert complaint("REST", ("v1", "a" * 16), "v1", "a" * 16) == ""
    words = complaint("REST", ("v1", "a" * 16), "v1", "b" * 16)
    assert f"| REST | v1 | `{'b' * 16}` |" in words
    assert "SERVED in" in words
    assert "WIRE in" in complaint("keys and messages", ("v1", "a" * 16), "v1", "b" * 16)
    assert "write | REST | v2 |" in complaint("REST", ("v1", "a" * 16), "v2", "a" * 16)
    assert "write | REST | v1 |" in complaint("REST", None, "v1", "a" * 16)
