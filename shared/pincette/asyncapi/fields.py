"""What the source says of a message: its texts, and the records within it."""

import ast
import inspect
import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import is_dataclass
from typing import Any, get_args, get_type_hints


def summary(kind: type) -> str:
    """First paragraph of a record's docstring, in Markdown, on one line."""
    return _plain((inspect.getdoc(kind) or "").split("\n\n")[0])


def notes(kind: type) -> dict[str, str]:
    """The text under each field in the source, in Markdown; fields without one are left out."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    found: dict[str, str] = {}
    for field, after in zip(tree.body, tree.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            match after:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    found[field.target.id] = _plain(text)
                case _:
                    pass
    return found


def reachable(kinds: Iterable[Any]) -> Iterator[type]:
    """These records, each followed by the records that its fields carry, once each."""
    seen: set[type] = set()
    waiting = list(kinds)
    while waiting:
        kind = waiting.pop(0)
        if is_dataclass(kind) and isinstance(kind, type):
            if kind not in seen:
                seen.add(kind)
                yield kind
                waiting[:0] = get_type_hints(kind).values()
        else:
            waiting[:0] = get_args(kind)


def _plain(text: str) -> str:
    return " ".join(text.split()).replace("``", "`")
