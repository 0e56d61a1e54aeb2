"""Kinds of job import only the public API of the supervisor."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from pincette_supervisor import plugin

ROOT = Path(__file__).resolve().parents[3]
PLUGIN = "pincette_supervisor.plugin"
PUBLIC = {PLUGIN} | {
    f"{PLUGIN}.{name}"
    for name in (
        "drawing",
        "error_sources",
        "figures",
        "goal",
        "laws",
        "pair_plans",
        "plans",
        "release",
        "result",
        "zero_return",
    )
}
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


@pytest.mark.parametrize("folder", [KINDS, EXAMPLE])
def test_kinds_import_only_the_public_api(folder: Path) -> None:
    found = {
        (module, name)
        for module, name in imported(folder)
        if not module.startswith("pincette_supervisor.kinds")
    }
    assert found
    for module, name in found:
        assert module in PUBLIC
        assert not name.startswith("_")
        assert module != PLUGIN or name in plugin.__all__ or f"{PLUGIN}.{name}" in PUBLIC
