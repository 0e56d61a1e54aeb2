"""Findings about missing requirements of a rig, with remedies; nothing is printed."""

from dataclasses import dataclass
from typing import Literal

Mark = Literal["ok", "missing", "note"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check: whether it passed, and the remedy if it did not."""

    ok: bool
    what: str
    remedy: str = ""
    note: bool = False
    """True for a hint, which has neither passed nor failed."""

    @property
    def mark(self) -> Mark:
        """Return the mark that shows the result."""
        return "note" if self.note else "ok" if self.ok else "missing"


def noted(what: str, remedy: str = "") -> Finding:
    """Return a hint for people, which does not count as a failed check."""
    return Finding(True, what, remedy, note=True)
