"""The page about the wire states the actual limits."""

import re
from pathlib import Path

from pincette.control.quantities import (
    LARGEST,
    LARGEST_INT,
    LAST_SEQ,
    MAX_DOCUMENT,
    MAX_ITEMS,
    MAX_TEXT,
)
from pincette.core.codec import MAX_BYTES
from pincette.core.codec.refusals import MAX_FIELDS
from pincette.core.codec.wire import ENCODING, update_which
from pincette.core.topics import ROOT

PAGE = (Path(__file__).parents[3] / "docs/explanations/wire.md").read_text(encoding="utf-8")


def test_every_bound_of_a_number_is_on_the_page() -> None:
    (table,) = re.findall(r"\| unit \| largest magnitude \|\n.*\n((?:\|.*\n)+)", PAGE)
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
    values = {"" if unit == "none" else unit: float(bound) for unit, bound in rows}
    assert values == dict(LARGEST)


def test_the_wire_page_states_sizes_and_versions() -> None:
    for words in (
        f"| {MAX_BYTES} bytes |",
        f"| {MAX_FIELDS} fields |",
        f"| {MAX_ITEMS} items |",
        f"| {MAX_TEXT} characters;",
        f"| {MAX_DOCUMENT} characters |",
        f"| -1 to {LAST_SEQ} |",
        f"| 0 to {LARGEST_INT} |",
        f"`{ENCODING}`",
        f"`{ROOT}/…`",
        update_which("controller", 3),
        update_which("sensor", 3),
    ):
        assert words in PAGE
