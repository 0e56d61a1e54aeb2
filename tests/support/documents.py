"""Fenced blocks of the documents, and how a test types those that the register names."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
TYPED = ("sh", "python")
"""Languages of blocks that a reader types or runs."""
GENERATED = ("docs/reference/rest.md",)


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block."""

    page: str
    language: str
    text: str

    @property
    def first(self) -> str:
        """First line of the block."""
        return self.text.splitlines()[0] if self.text else ""


@dataclass(frozen=True, slots=True)
class Typed:
    """A block that a test types, as a reader would."""

    first: str
    """Beginning of its first line."""
    says: str = ""
    """Expected output, as a regular expression."""
    status: int = 0
    """Exit status of its last command."""
    stays: bool = False
    """True if it runs until the end of the page."""
    until: bool = False
    """True if it runs until Ctrl-C, which is sent after the expected output."""
    seconds: float = 60.0


@dataclass(frozen=True, slots=True)
class Sitting:
    """Blocks of one page that a test types, in the page's order, and the rig they need."""

    blocks: tuple[Typed, ...]
    up: str = ""
    """Rig file for `pincette up` before the first block; empty if no rig is started."""
    slow: bool = False
    """True if the page is typed only by `make soak`."""


def pages() -> list[Path]:
    """Return every document from which a reader may type."""
    found = [*(ROOT / "docs").rglob("*.md"), *(ROOT / "services").glob("*/README.md")]
    return [ROOT / "README.md", *sorted(found)]


def blocks_of(path: Path) -> Iterator[Block]:
    """Return the fenced blocks of a page, in order."""
    page = str(path.relative_to(ROOT))
    for language, text in FENCE.findall(path.read_text(encoding="utf-8")):
        yield Block(page, language, text)


def typed_blocks(page: str) -> list[Block]:
    """Return the blocks of a page that a reader types or runs."""
    return [block for block in blocks_of(ROOT / page) if block.language in TYPED]


def named(page: str, sitting: Sitting) -> Iterator[tuple[Block, Typed]]:
    """Find the blocks that the register names, in the page's order; fail where one is missing."""
    blocks = iter(typed_blocks(page))
    for typed in sitting.blocks:
        block = next((one for one in blocks if one.text.startswith(typed.first)), None)
        assert block is not None, f"{page} has no block that begins with {typed.first!r}"
        yield block, typed
