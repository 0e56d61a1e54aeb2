"""Each block of the documents is in the register once; toml, json and python are sound."""

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pincette.config import ConfigError, parse_rig
from pincette.config.reading import laid_over
from tests.support.document_register import ELSEWHERE, SITTINGS
from tests.support.documents import (
    FENCE,
    GENERATED,
    TYPED,
    Block,
    Sitting,
    Told,
    Typed,
    blocks_of,
    pages,
    typed_blocks,
)

REGISTER = "tests/support/document_register.py"
COMMAND = re.compile(r"(?:\.venv/bin/)?(?:pincette|python3?|pip|make|curl|docker|kill|export|git) ")
KNOWN = {"", "sh", "python", "toml", "json", "ini", "console", "yaml", "promql", "js", "nginx"}


def every_block() -> list[Block]:
    return [block for path in pages() for block in blocks_of(path)]


def misfits(page: str, blocks: list[Block], sitting: Sitting | None) -> Iterator[str]:
    """How a page and its entry differ, with what to do."""
    if sitting is None:
        yield (
            f"{page} has {len(blocks)} blocks of sh or python and no entry in SITTINGS of "
            f"{REGISTER}: add one, with Typed or Told for each, in this order: "
            f"{[block.first for block in blocks]}"
        )
        return
    for number, block in enumerate(blocks, start=1):
        said = sitting.blocks[number - 1] if number <= len(sitting.blocks) else None
        if said is None or not block.text.startswith(said.first):
            yield (
                f"{page}: block {number} begins with {block.first!r}, its entry in {REGISTER} with "
                f"{said.first if said else 'nothing'!r}: write Typed or Told for it, in its place"
            )
            return
    if len(blocks) < len(sitting.blocks):
        yield f"{page}: {REGISTER} has {sitting.blocks[len(blocks)].first!r}, which is not there"


def test_every_block_is_in_the_register() -> None:
    held = {block.page for block in every_block() if block.language in TYPED} - {*ELSEWHERE}
    found = [
        misfit
        for page in sorted(held | SITTINGS.keys())
        for misfit in misfits(page, typed_blocks(page), SITTINGS.get(page))
    ]
    assert found == [], "\n".join(found)


def test_misfits_are_told_with_what_to_do() -> None:
    one, two = Block("a.md", "sh", "make demo\n"), Block("a.md", "sh", "make up\n")
    (words,) = misfits("a.md", [one], None)
    assert "no entry" in words
    assert "make demo" in words
    (words,) = misfits("a.md", [one, two], Sitting((Typed("make demo"),)))
    assert "block 2 begins with 'make up'" in words
    (words,) = misfits("a.md", [two], Sitting((Told("make demo", "x"),)))
    assert "'make demo'" in words
    (words,) = misfits("a.md", [one], Sitting((Typed("make demo"), Typed("make up"))))
    assert "which is not there" in words
    assert list(misfits("a.md", [one], Sitting((Typed("make demo"),)))) == []


def test_what_is_not_typed_has_a_reason(capsys: pytest.CaptureFixture[str], root: Path) -> None:
    told = [
        (page, block)
        for page, sitting in SITTINGS.items()
        for block in sitting.blocks
        if isinstance(block, Told)
    ]
    with capsys.disabled():
        print()
        for page, block in told:
            print(f"  not typed: {page}: {block.first}: {block.why}")
    for _, block in told:
        assert len(block.why) > 10
        for named in re.findall(r"[\w/-]+\.(?:py|md)", block.why):
            assert (root / named).exists() or list((root / "tests").rglob(named)), named
    assert all((root / test).exists() for test in ELSEWHERE.values())


def test_no_command_stands_in_an_indented_block() -> None:
    found = [
        f"{path.name}: {line.strip()}"
        for path in pages()
        for before, line in lines_outside_fences(path)
        if before == "" and line.startswith("    ") and COMMAND.match(line.strip())
    ]
    assert found == [], "put it between ```sh and ```"


def lines_outside_fences(path: Path) -> Iterator[tuple[str, str]]:
    """Each line of a page with the one before it, without its fenced blocks."""
    lines = FENCE.sub("-", path.read_text(encoding="utf-8")).splitlines()
    yield from zip(["", *lines], lines, strict=False)


def test_every_fence_is_of_a_known_language() -> None:
    assert {block.language for block in every_block()} <= KNOWN


def rig_of(tables: dict[str, Any], root: Path) -> None:
    """Lay tables over a rig file and check what comes of it; raises ConfigError."""
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
def test_toml_is_a_part_of_a_rig_file(block: Block, root: Path) -> None:
    tables = tomllib.loads(block.text)
    if "build-system" in tables:
        assert tables["project"]["entry-points"], "a package that registers a driver"
        return
    rig_of(tables, root)


def test_a_rig_file_within_a_command_is_sound(root: Path) -> None:
    found = [
        text
        for block in every_block()
        for text in re.findall(r"\.toml <<'END'\n(.*?)^END$", block.text, re.MULTILINE | re.DOTALL)
    ]
    assert found
    for text in found:
        rig_of(tomllib.loads(text), root)


def test_a_wrong_table_is_seen(root: Path) -> None:
    with pytest.raises(ConfigError, match="perod_s"):
        rig_of({"rig": {"perod_s": 0.01}}, root)


def test_json_is_json_and_python_compiles() -> None:
    blocks = every_block()
    for block in blocks:
        if block.language == "json":
            json.loads(block.text)
        if block.language == "python":
            compile(block.text, block.page, "exec")
    assert any(block.language == "json" and block.page in GENERATED for block in blocks)
