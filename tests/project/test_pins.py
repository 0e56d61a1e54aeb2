"""Pinned requirements: every dependency once, with hashes, and no index."""

import re
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PIN = re.compile(r"^(?P<pin>[a-z0-9._-]+==[^\s;]+(?: ; [^\\]+?)?) \\$")
HASH = re.compile(r"^    --hash=sha256:[0-9a-f]{64}(?: \\)?$")


def pinned(root: Path, name: str = "dev") -> tuple[dict[str, list[Requirement]], list[str]]:
    """Return the pins by name, and the lines that are neither a pin nor a hash."""
    pins: dict[str, list[Requirement]] = {}
    odd: list[str] = []
    lines = (root / f"requirements/{name}.txt").read_text(encoding="utf-8").splitlines()
    for line, after in zip(lines, [*lines[1:], ""], strict=True):
        found = PIN.match(line)
        if found and HASH.match(after):
            requirement = Requirement(found["pin"])
            pins.setdefault(canonicalize_name(requirement.name), []).append(requirement)
        elif not HASH.match(line):
            odd.append(line)
    return pins, odd


@pytest.mark.parametrize("name", ["contrib", "dev"])
def test_requirements_contain_only_pins_with_hashes(root: Path, name: str) -> None:
    pins, odd = pinned(root, name)
    assert len(pins) > 20
    assert odd == []


@pytest.mark.parametrize("python", ["3.11.0", "3.12.0", "3.13.0"])
def test_every_dependency_is_pinned_once(
    root: Path, pyproject: dict[str, Any], python: str
) -> None:
    pins, _ = pinned(root)
    environment = {"python_full_version": python, "python_version": python[:4]}
    project = pyproject["project"]
    wanted = [Requirement(text) for text in project["dependencies"]]
    # A distribution of this tree, installed from it.
    assert Requirement(f"pincette-client=={project['version']}") == wanted.pop(
        [one.name for one in wanted].index("pincette-client")
    )
    wanted += [Requirement(text) for text in project["optional-dependencies"]["dev"]]
    for requirement in wanted:
        here = [
            pin
            for pin in pins.get(canonicalize_name(requirement.name), [])
            if pin.marker is None or pin.marker.evaluate(environment)
        ]
        assert len(here) == 1, f"{requirement} has {len(here)} pins: run `make pins`"
        (version,) = [item.version for item in here[0].specifier]
        assert requirement.specifier.contains(version), f"{here[0]} is not {requirement}"
