"""What is missing for a rig, and how to get it, as findings; nothing is printed."""

from dataclasses import dataclass
from typing import Literal

Mark = Literal["well", "missing", "note"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing looked at: whether it is well, and what to do where it is not."""

    well: bool
    what: str
    remedy: str = ""
    note: bool = False
    """Neither well nor missing: what a person should know."""

    @property
    def mark(self) -> Mark:
        """How it is shown."""
        return "note" if self.note else "well" if self.well else "missing"


def noted(what: str, remedy: str = "") -> Finding:
    """Make a finding that a person should know of, and that stops nothing."""
    return Finding(True, what, remedy, note=True)
