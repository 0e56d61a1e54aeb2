"""The data of the fault table, ``fault_table.toml``: rows, and the tests that cover them."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

REGISTER = Path(__file__).with_suffix(".toml")


@dataclass(frozen=True, slots=True)
class Row:
    """One fault. Tests are named as pytest names them: file, two colons, function."""

    number: int
    fault: str
    noticed_by: str
    must: str
    virtual: tuple[str, ...]
    """Tests in virtual time: the same numbers in every run."""
    real: tuple[str, ...]
    """Tests with real processes, on real links."""
    twin: tuple[str, ...]
    """Tests that nothing trips just below the limit."""
    open: str = ""
    """Known deviation that remains; empty if there is none."""


def _row(entry: dict[str, Any]) -> Row:
    virtual, real, twin = (tuple[str, ...](entry.pop(name)) for name in ("virtual", "real", "twin"))
    return Row(**entry, virtual=virtual, real=real, twin=twin)


ROWS = tuple(_row(entry) for entry in tomllib.loads(REGISTER.read_text(encoding="utf-8"))["row"])
