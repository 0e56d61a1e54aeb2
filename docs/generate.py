"""Write the pages that are derived from the code: `make docs`."""

import runpy
from collections.abc import Callable
from enum import EnumType, StrEnum
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints

from msgspec import structs

from pincette.asyncapi.document import document
from pincette.asyncapi.schemas import notes, reachable, summary
from pincette.control.quantities import Document
from pincette.core import topics
from pincette.core.units import unit_of

Pages = dict[Any, Callable[[], str]]
ROOT = Path(__file__).resolve().parents[1]
REFERENCE = ROOT / "docs" / "reference"

PLAIN = {
    float: "number",
    int: "whole number",
    bool: "true or false",
    str: "text",
    Document: "text",
}

NOTHING: dict[Any, str] = {type(None): "nil"}
HEAD = """\
# Keys

Generated from `pincette.core.topics` by `make docs`; a test compares the two. Programs read
[deploy/asyncapi.json](../../deploy/asyncapi.json), which the supervisor serves at `/asyncapi.json`.

Every key begins with `{root}/` and the name of the rig. A payload is one MessagePack map. It has
every field below, by name, and no other field. nil stands for Python's None. Forces are compressive
and positive. `arms` has one record for each driven arm, the first arm first.

"""


def keys_page() -> str:
    """Return the page of topics, requests and messages, as Markdown."""
    kinds = [topic.message for topic in (*topics.TOPICS, *topics.INPUTS)]
    kinds += [kind for item in topics.REQUESTS for kind in (item.request, item.reply)]
    parts = [HEAD.format(root=topics.ROOT), _topics(), _questions(), _others()]
    parts.extend(_record(kind) for kind in reachable(kinds))
    return "".join(parts).rstrip() + "\n"


def _table(*rows: tuple[str, ...]) -> str:
    first, *rest = ("| " + " | ".join(row) + " |\n" for row in rows)
    return first + "|" + " --- |" * len(rows[0]) + "\n" + "".join(rest) + "\n"


TOPICS_TEXT = """\
A query without a payload on the key of a topic returns its newest message, as long as its producer
runs. `timing` and `request_log` have a key for each service of the loop ({loop}),
so that each key has one producer. [Subscribe from your own tools](../how-to/listen.md) shows how to
query.

The column *while* names the states of a rig in real time in which a topic is published: `latched`,
`idle` (no job), `job` (a job plays its program). In lockstep nothing is published each tick outside
a job, and no `timing`. After a job the newest message of a topic that is published in a job is its
last one.

`place` goes the other way: clients publish it, and the supervisor alone reads it, for jobs whose
request asks for [a place from the bus](../how-to/place.md).

"""


REQUESTS_TEXT = """\
Send a query with the request as payload to all queryables: `target=QueryTarget.ALL` and
`consolidation=ConsolidationMode.NONE`. By default Zenoh asks the best matching queryable only,
which may be a store of another program. A refusal is an error reply with the reason.

A program returns the attachment of the query, up to 64 bytes, with its reply. With a refusal it
returns it as the schema of the encoding, in hexadecimal digits. That tells its reply from those of
other tools.

"""


def _topics() -> str:
    rows = [
        (
            f"`{topics.key('{rig}', topic, '{service}')}`",
            _link(topic.message),
            topic.producer,
            ", ".join(topic.published),
            "every tick" if topic.per_tick else "not every tick",
            topic.summary,
        )
        for topic in (*topics.TOPICS, *topics.INPUTS)
    ]
    head = ("key", "message", "producer", "while", "how often", "what")
    return "## Topics\n\n" + TOPICS_TEXT.format(loop=", ".join(topics.LOOP)) + _table(head, *rows)


def _questions() -> str:
    rows = [
        (
            f"`{topics.request_key('{rig}', item)}`",
            _link(item.request),
            _link(item.reply),
            item.summary,
        )
        for item in topics.REQUESTS
    ]
    table = _table(("key", "request", "reply", "what"), *rows)
    return f"## Requests\n\n{REQUESTS_TEXT}{table}"


def _others() -> str:
    key = topics.live_key("{rig}", "{program}")
    return f"## Liveliness\n\nEvery running program holds the token `{key}`.\n\n## Messages\n\n"


def _record(kind: type) -> str:
    hints, texts = get_type_hints(kind), notes(kind)
    rows = [
        (
            f"`{field.name}`",
            _type(hints[field.name]),
            unit_of(field.name),
            _cell(texts.get(field.name, "")),
        )
        for field in structs.fields(kind)
    ]
    head = f"### {kind.__name__}\n\n{_cell(summary(kind))}\n\n"
    return head + (
        _table(("field", "type", "unit", "meaning"), *rows) if rows else "An empty map.\n\n"
    )


def _type(hint: Any) -> str:
    if hint in PLAIN:
        return PLAIN[hint]
    arguments = get_args(hint)
    if get_origin(hint) in (Union, UnionType):
        return " or ".join(NOTHING.get(item) or _type(item) for item in arguments)
    if get_origin(hint) is Literal:
        return ", ".join(f"`{item}`" for item in arguments)
    if get_origin(hint) is tuple:
        return f"list of {_type(arguments[0])}"
    if isinstance(hint, EnumType):
        return ", ".join(f"`{item}`" for item in cast("type[StrEnum]", hint))
    return _link(hint)


def _link(kind: type) -> str:
    return f"[{kind.__name__}](#{kind.__name__.lower()})"


def _cell(text: str) -> str:
    return text.replace("|", r"\|")


def _pages(name: str) -> Pages:
    """Return the pages that other modules in this folder generate."""
    return runpy.run_path(str(ROOT / "docs" / name))["PAGES"]


NAMES = ("job_states.py", "fault_table.py", "metrics_table.py", "bounds_table.py")
IN_DOCS = {place: page for name in NAMES for place, page in _pages(name).items()}
PAGES: dict[Path, Callable[[], str]] = {
    REFERENCE / "keys.md": keys_page,
    ROOT / "deploy" / "asyncapi.json": document,
    **{ROOT / "docs" / place: page for place, page in IN_DOCS.items()},
    **_pages("generate_rest.py"),
    **_pages("generate_configuration.py"),
}


def main() -> None:
    """Write every page."""
    for path, page in PAGES.items():
        path.write_text(page(), encoding="utf-8")
        print(path.relative_to(ROOT))


if __name__ == "__main__":
    main()
