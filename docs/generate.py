"""Write the pages of docs/reference that are derived from the code: `make docs`."""

import ast
import inspect
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from pincette import topics
from pincette.messages import Document

REFERENCE = Path(__file__).resolve().parent / "reference"

UNITS = {"_mN_per_um": "mN/µm", "_um": "µm", "_mN": "mN", "_V": "V", "_s": "s"}
PLAIN = {
    float: "number",
    int: "whole number",
    bool: "true or false",
    str: "text",
    Document: "text",
}

HEAD = """\
# Keys

Generated from `pincette.topics` by `make docs`; a test compares the two.

Every key begins with `{root}/` and the name of the rig. A payload is one MessagePack map that
has every field below, by name, and no other; nil stands for Python's None. Forces are compressive
and positive.

"""


def keys_page() -> str:
    """The page of topics, questions and messages, as Markdown."""
    kinds = [topic.message for topic in topics.TOPICS]
    kinds += [kind for item in topics.QUESTIONS for kind in (item.request, item.reply)]
    parts = [HEAD.format(root=topics.ROOT), _topics(), _questions(), _others()]
    parts.extend(_record(kind) for kind in _reachable(kinds))
    return "".join(parts).rstrip() + "\n"


def _table(*rows: tuple[str, ...]) -> str:
    first, *rest = ("| " + " | ".join(row) + " |\n" for row in rows)
    return first + "|" + " --- |" * len(rows[0]) + "\n" + "".join(rest) + "\n"


def _topics() -> str:
    rows = [
        (
            f"`{topics.key('{rig}', topic)}`",
            _link(topic.message),
            topic.producer,
            "every tick" if topic.per_tick else "where asked for",
            topic.summary,
        )
        for topic in topics.TOPICS
    ]
    return "## Topics\n\n" + _table(("key", "message", "from", "when", "what"), *rows)


def _questions() -> str:
    rows = [
        (
            f"`{topics.question_key('{rig}', item)}`",
            _link(item.request),
            _link(item.reply),
            item.summary,
        )
        for item in topics.QUESTIONS
    ]
    text = "A query with the request as payload; a refusal is an error reply whose text says why.\n"
    table = _table(("key", "request", "reply", "what"), *rows)
    return f"## Questions\n\n{text}\n{table}"


def _others() -> str:
    key = topics.live_key("{rig}", "{program}")
    return f"## Liveliness\n\nEvery running program holds the token `{key}`.\n\n## Messages\n\n"


def _reachable(kinds: list[Any]) -> Iterator[type]:
    """The messages, each followed by the records its fields carry, once each."""
    seen: set[type] = set()
    while kinds:
        kind = kinds.pop(0)
        if is_dataclass(kind) and isinstance(kind, type) and kind not in seen:
            seen.add(kind)
            yield kind
            kinds[:0] = get_type_hints(kind).values()
        else:
            kinds[:0] = get_args(kind)


def _record(kind: type) -> str:
    title, summary = kind.__name__, (inspect.getdoc(kind) or "").split("\n\n")[0]
    hints, notes = get_type_hints(kind), _notes(kind)
    names = [field.name for field in fields(kind)]
    rows = [(f"`{name}`", _type(hints[name]), _unit(name), notes.get(name, "")) for name in names]
    head = f"### {title}\n\n{_markdown(summary)}\n\n"
    return head + (
        _table(("field", "type", "unit", "meaning"), *rows) if rows else "An empty map.\n\n"
    )


def _notes(kind: type) -> dict[str, str]:
    """The text under each field in the source."""
    (tree,) = ast.parse(inspect.getsource(kind)).body
    assert isinstance(tree, ast.ClassDef)
    notes: dict[str, str] = {}
    for field, after in zip(tree.body, tree.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            match after:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    notes[field.target.id] = _markdown(" ".join(text.split()))
                case _:
                    pass
    return notes


def _type(hint: Any) -> str:
    if hint in PLAIN:
        return PLAIN[hint]
    arguments = get_args(hint)
    if get_origin(hint) in (Union, UnionType):
        return " or ".join("nil" if item is type(None) else _type(item) for item in arguments)
    if get_origin(hint) is Literal:
        return ", ".join(f"`{item}`" for item in arguments)
    if get_origin(hint) is tuple:
        return f"list of {_type(arguments[0])}"
    return _link(hint)


def _unit(name: str) -> str:
    return next((unit for suffix, unit in UNITS.items() if name.endswith(suffix)), "")


def _link(kind: type) -> str:
    return f"[{kind.__name__}](#{kind.__name__.lower()})"


def _markdown(text: str) -> str:
    return re.sub(r"``", "`", text).replace("|", r"\|")


PAGES = {REFERENCE / "keys.md": keys_page}


def main() -> None:
    """Write every page."""
    for path, page in PAGES.items():
        path.write_text(page(), encoding="utf-8")
        print(path.relative_to(REFERENCE.parents[1]))


if __name__ == "__main__":
    main()
