"""Row 16: no program of the loop reads a wall clock, so setting it cannot affect the loop."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
LOOP = (
    "services/sensor",
    "services/estimator",
    "services/controller",
    "services/actuator",
    "shared/pincette/control",
    "shared/pincette/core/messages",
    "shared/pincette/core/codec",
    "shared/pincette/instruments",
    "shared/pincette/bus",
    "shared/pincette/engine",
    "shared/pincette/sim",
    "shared/pincette/core/service.py",
    "shared/pincette/core/topics.py",
)
WALL = {("time", "time"), ("time", "time_ns"), ("datetime", "datetime"), ("datetime", "date")}
NOT_IN_A_TICK = {
    "shared/pincette/bus/endpoints.py": "dates of certificates, once, before the start",
    "shared/pincette/bus/vouching.py": "dates of certificates, where a link begins",
}


def readers() -> Iterator[str]:
    """Return every place in the code that could read one."""
    for place in LOOP:
        root = ROOT / place
        for path in sorted(root.rglob("*.py")) if root.is_dir() else [root]:
            name = path.relative_to(ROOT).as_posix()
            if name not in NOT_IN_A_TICK:
                tree = ast.parse(path.read_text(encoding="utf-8"))
                yield from (f"{name}:{line}" for line in _wall(tree))


def _wall(tree: ast.AST) -> Iterator[int]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            names = {(node.module or "", item.name) for item in node.names}
            if names & WALL:
                yield node.lineno
        elif (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and (node.value.id, node.attr) in WALL
        ):
            yield node.lineno


def test_nothing_in_the_loop_reads_a_wall_clock() -> None:
    assert list(readers()) == []
