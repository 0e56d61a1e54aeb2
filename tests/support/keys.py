"""Valid keys of a supervisor, and requests that send them."""

from dataclasses import dataclass
from typing import get_args

from pincette.api.access import Scope
from pincette_supervisor.access.authentication import Authenticator, digest_of, new_key
from pincette_supervisor.journal.access import KeyFile
from pincette_supervisor.journal.store import Store


@dataclass(frozen=True)
class ScopeKeys:
    """Keys by their scope."""

    keys: dict[Scope, str]

    def headers(self, scope: Scope) -> dict[str, str]:
        """Return the headers with the key of a scope."""
        return shown(self.keys[scope])


def shown(key: str) -> dict[str, str]:
    """Return the header with a key."""
    return {"Authorization": f"Bearer {key}"}


def key_of_each_scope(store: Store, gate: Authenticator | None = None) -> ScopeKeys:
    """Create keys ``an-observe``, ``an-operate`` and ``an-admin``, valid from now on."""
    keys: dict[Scope, str] = {scope: new_key() for scope in get_args(Scope)}
    file = KeyFile(store.folder)
    for scope, key in keys.items():
        file.add(f"an-{scope}", digest_of(key), scope)
    if gate is not None:
        gate.refresh(store)
    return ScopeKeys(keys)
