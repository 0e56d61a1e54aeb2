"""Kinds of job import the public API of the supervisor alone."""

import ast
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from pincette_supervisor.plugin import drawing

ROOT = Path(__file__).resolve().parents[3]
PUBLIC = ("", ".plans", ".figures", ".drawing")
KINDS = ROOT / "services/supervisor/pincette_supervisor/kinds"
EXAMPLE = ROOT / "docs/examples/job_kind/pincette_example_tap"


def imported(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield module and name of each import from the supervisor, except of other kinds."""
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            assert not isinstance(node, ast.ImportFrom) or node.level == 0, path
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            assert not any(name.startswith("pincette_supervisor") for name in names), path
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(
                "pincette_supervisor"
            ):
                yield from ((node.module or "", alias.name) for alias in node.names)


@pytest.fixture(scope="module")
def public() -> set[tuple[str, str]]:
    """Every name that a kind of job may import."""
    root = "pincette_supervisor.plugin"
    found = {(root, name.removeprefix(".")) for name in PUBLIC[1:]}
    for module in PUBLIC[:-1]:
        found |= {(root + module, name) for name in import_module(root + module).__all__}
    return found | {(drawing.__name__, name) for name in vars(drawing) if not name.startswith("_")}


def test_kinds_of_the_product_import_the_public_api_alone(public: set[tuple[str, str]]) -> None:
    found = {
        (module, name)
        for module, name in imported(KINDS)
        if not module.startswith("pincette_supervisor.kinds")
    }
    assert found
    assert found <= public, sorted(found - public)


def test_the_example_kind_imports_the_public_api_alone(public: set[tuple[str, str]]) -> None:
    found = set(imported(EXAMPLE))
    assert found
    assert found <= public, sorted(found - public)
