"""The fault table has every row, and names tests that exist."""

import ast
from pathlib import Path

from tests.support.fault_table import ROWS

NUMBERS = 40


def functions(path: Path) -> set[str]:
    """Return the names of the tests in a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {item.name for item in ast.walk(tree) if isinstance(item, ast.FunctionDef)}


def test_every_row_is_listed_once() -> None:
    assert [row.number for row in ROWS] == list(range(1, NUMBERS + 1))


def test_every_test_that_is_named_exists(root: Path) -> None:
    missing: list[str] = []
    for row in ROWS:
        for test in (*row.virtual, *row.real, *row.twin):
            path, _, name = test.partition("::")
            if not (root / path).is_file() or (name and name not in functions(root / path)):
                missing.append(f"row {row.number}: {test}")
    assert not missing, "tests/support/fault_table.toml names tests that were renamed or deleted"


def test_every_row_names_a_test_and_a_counterpart() -> None:
    for row in ROWS:
        assert row.virtual or row.real, row.number
        assert row.twin, row.number
