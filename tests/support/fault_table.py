"""The register of the fault table, ``fault_table.toml``: rows, and the tests that show them."""

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
    """In virtual time: the same numbers at every run."""
    real: tuple[str, ...]
    """Real processes, on real links."""
    twin: tuple[str, ...]
    """That nothing trips just below."""
    open: str = ""
    """What is not as it should be yet; empty where all is."""


def _row(entry: dict[str, Any]) -> Row:
    virtual, real, twin = (tuple[str, ...](entry.pop(name)) for name in ("virtual", "real", "twin"))
    return Row(**entry, virtual=virtual, real=real, twin=twin)


ROWS = tuple(_row(entry) for entry in tomllib.loads(REGISTER.read_text(encoding="utf-8"))["row"])
