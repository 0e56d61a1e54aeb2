"""What is missing for a rig, and how to get it, as findings; nothing is printed."""

from dataclasses import dataclass
from typing import Literal

Mark = Literal["ok", "missing", "note"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One check: whether it passed, and the remedy if it did not."""

    ok: bool
    what: str
    remedy: str = ""
    note: bool = False
    """A hint that is neither passed nor missing."""

    @property
    def mark(self) -> Mark:
        """Return the mark with which it is shown."""
        return "note" if self.note else "ok" if self.ok else "missing"


def noted(what: str, remedy: str = "") -> Finding:
    """Return a hint for people that stops nothing."""
    return Finding(True, what, remedy, note=True)
