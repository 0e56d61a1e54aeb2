"""Keys in force at a supervisor, and requests that show them."""

from dataclasses import dataclass
from typing import get_args

from pincette.api.access import Scope
from pincette_supervisor.access.authentication import Authenticator, digest_of, new_key
from pincette_supervisor.journal.access_rows import KeyRepository
from pincette_supervisor.journal.database import Database


@dataclass(frozen=True)
class ScopeKeys:
    """A key of each scope, by its scope."""

    keys: dict[Scope, str]

    def headers(self, scope: Scope) -> dict[str, str]:
        """What shows the key of a scope."""
        return shown(self.keys[scope])


def shown(key: str) -> dict[str, str]:
    """The header that shows a key."""
    return {"Authorization": f"Bearer {key}"}


def key_of_each_scope(store: Database, gate: Authenticator | None = None) -> ScopeKeys:
    """Keys ``an-observe``, ``an-operate`` and ``an-admin``, in force from here on."""
    keys: dict[Scope, str] = {scope: new_key() for scope in get_args(Scope)}
    book = KeyRepository(store)
    for scope, key in keys.items():
        book.add(f"an-{scope}", digest_of(key), scope)
    if gate is not None:
        gate.refresh(book)
    return ScopeKeys(keys)
