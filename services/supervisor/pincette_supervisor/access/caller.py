"""Who asks, as far as it is known."""

from dataclasses import dataclass
from typing import Literal

from pincette.api.access_models import Scope

Way = Literal["open", "key", "session", "none"]


@dataclass(frozen=True, slots=True)
class Caller:
    """Who asks, from where, and what they may do."""

    address: str
    name: str | None = None
    """Of the key; None where none is in force, or none was shown that opens anything."""
    scope: Scope | None = None
    """None: nothing."""
    way: Way = "none"
    showed: bool = False
    """Whether something was shown that should have opened."""

    def signed(self, label: str) -> str:
        """The name that an action is kept under: that of the key, and what the caller says beside.

        A label alone is a name only where no key is wanted.
        """
        if self.name is None:
            return (label if self.way == "open" else "") or self.address
        return f"{self.name} ({label})" if label else self.name
