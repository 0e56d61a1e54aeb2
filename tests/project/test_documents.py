"""Blocks of the documents: toml, json and python are valid, commands are in fenced blocks."""

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pincette.config import parse_rig
from pincette.config.reading import laid_over
from tests.support.document_register import SITTINGS
from tests.support.documents import FENCE, GENERATED, Block, blocks_of, named, pages

COMMAND = re.compile(r"(?:\.venv/bin/)?(?:pincette|python3?|pip|make|curl|docker|kill|export|git) ")
KNOWN = {"", "sh", "python", "toml", "json", "ini", "console", "yaml", "promql", "js", "nginx"}


def every_block() -> list[Block]:
    return [block for path in pages() for block in blocks_of(path)]


@pytest.mark.parametrize("page", SITTINGS)
def test_the_list_of_tested_blocks_names_existing_blocks(page: str) -> None:
    assert len(list(named(page, SITTINGS[page]))) == len(SITTINGS[page].blocks)


def test_no_command_is_in_an_indented_block() -> None:
    found = [
        f"{path.name}: {line.strip()}"
        for path in pages()
        for before, line in lines_outside_fences(path)
        if before == "" and line.startswith("    ") and COMMAND.match(line.strip())
    ]
    assert found == [], "put the command between ```sh and ```"


def lines_outside_fences(path: Path) -> Iterator[tuple[str, str]]:
    """Return each line of a page outside its fenced blocks, with the previous line."""
    lines = FENCE.sub("-", path.read_text(encoding="utf-8")).splitlines()
    yield from zip(["", *lines], lines, strict=False)


def test_every_code_block_has_a_known_language() -> None:
    assert {block.language for block in every_block()} <= KNOWN


def rig_of(tables: dict[str, Any], root: Path) -> None:
    """Merge tables into a rig file and validate the result; raises ConfigError."""
    base = tables.pop("base", "deploy/rigs/demo.toml")
    below = tomllib.loads((root / base).read_text(encoding="utf-8"))
    parse_rig(laid_over(below, tables))


@pytest.mark.parametrize(
    "block",
    [
        pytest.param(block, id=f"{block.page}:{block.first}")
        for block in every_block()
        if block.language == "toml"
    ],
)
def test_toml_examples_are_parts_of_a_rig_file(block: Block, root: Path) -> None:
    tables = tomllib.loads(block.text)
    if "build-system" in tables:
        assert tables["project"]["entry-points"], "this package must register a driver"
        return
    rig_of(tables, root)


def test_a_rig_file_within_a_command_is_valid(root: Path) -> None:
    found = [
        text
        for block in every_block()
        for text in re.findall(r"\.toml <<'END'\n(.*?)^END$", block.text, re.MULTILINE | re.DOTALL)
    ]
    assert found
    for text in found:
        rig_of(tomllib.loads(text), root)


def test_json_blocks_are_valid_and_python_blocks_compile() -> None:
    blocks = every_block()
    for block in blocks:
        if block.language == "json":
            json.loads(block.text)
        if block.language == "python":
            compile(block.text, block.page, "exec")
    assert any(block.language == "json" and block.page in GENERATED for block in blocks)
