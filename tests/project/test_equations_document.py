"""The page of equations lists all equations of the paper, and each entry links to its code and
tests."""

import ast
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest

PAGES = (
    "docs/reference/equations.md",
    "docs/explanations/errata.md",
    "docs/explanations/method.md",
)
NUMBERS = range(1, 56)
ROW = re.compile(r"^\| \((\d+)\) \|(.*)\|$", re.MULTILINE)
CODE = re.compile(r"`(pincette(?:\.\w+)+)`")
TEST = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")
RANGE = re.compile(r"\((\d+)\) to \((\d+)\)")


class Row(NamedTuple):
    number: int
    where: str
    """Third cell of the row."""
    whole: str


def rows(root: Path) -> list[Row]:
    found: list[Row] = []
    for match in ROW.finditer((root / PAGES[0]).read_text(encoding="utf-8")):
        cells = re.split(r"(?<!\\)\|", match[2])
        assert len(cells) == 3, f"({match[1]}) has {len(cells) + 1} cells"
        found.append(Row(int(match[1]), cells[1], match[2]))
    return found


def resolve(path: str) -> tuple[ModuleType, Any]:
    """Return the module at the start of a dotted path, and the rest of the path."""
    parts = path.split(".")
    for end in range(len(parts), 0, -1):
        try:
            module = importlib.import_module(".".join(parts[:end]))
        except ModuleNotFoundError:
            continue
        found: Any = module
        for name in parts[end:]:
            found = getattr(found, name)
        return module, found
    raise ModuleNotFoundError(path)


def docstrings(thing: Any) -> Iterator[str]:
    """Return the docstring of an object, and those of its fields if it is a class."""
    yield inspect.getdoc(thing) or ""
    if inspect.isclass(thing):
        (tree,) = ast.parse(inspect.getsource(thing)).body
        assert isinstance(tree, ast.ClassDef)
        for node in tree.body:
            match node:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    yield text
                case _:
                    pass


def names_equation(text: str, number: int) -> bool:
    spans = ((int(first), int(last)) for first, last in RANGE.findall(text))
    return f"({number})" in text or any(first <= number <= last for first, last in spans)


def missing_tests(root: Path, text: str) -> list[str]:
    missing: list[str] = []
    for name, test in TEST.findall(text):
        path = root / name
        if not path.is_file():
            missing.append(name)
        elif test:
            tree = ast.parse(path.read_text(encoding="utf-8"))
            functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
            if test not in functions:
                missing.append(f"{name}::{test}")
    return missing


def test_every_equation_is_listed_once(root: Path) -> None:
    assert [row.number for row in rows(root)] == list(NUMBERS)


def test_every_reference_to_an_equation_is_valid(root: Path) -> None:
    nowhere = [
        row.number for row in rows(root) if not (CODE.search(row.where) or TEST.search(row.where))
    ]
    assert nowhere == []


def test_code_that_implements_an_equation_cites_its_number(root: Path) -> None:
    silent: list[str] = []
    for row in rows(root):
        for path in CODE.findall(row.whole):
            module, thing = resolve(path)
            texts = [*docstrings(thing), module.__doc__ or ""]
            if not any(names_equation(text, row.number) for text in texts):
                silent.append(f"({row.number}) {path}")
    assert silent == [], "docstrings that do not name their equation"


@pytest.mark.parametrize("page", PAGES)
def test_names_and_tests_that_a_page_mentions_exist(root: Path, page: str) -> None:
    text = (root / page).read_text(encoding="utf-8")
    for path in CODE.findall(text):
        resolve(path)
    assert missing_tests(root, text) == []
