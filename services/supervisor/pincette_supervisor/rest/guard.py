"""What each route demands of its caller, as a dependency that stands at the route."""

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import Depends, Request, Security
from fastapi.security import (
    APIKeyCookie,
    HTTPAuthorizationCredentials,
    HTTPBearer,
    SecurityScopes,
)
from fastapi.security.utils import get_authorization_scheme_param
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.types import Scope as AsgiScope

from pincette.api.access_models import MEANINGS, Scope
from pincette_supervisor.access.caller import Caller
from pincette_supervisor.access.gate import Gate, admit

COOKIE = "pincette_session"
CALLER, NOTE = "pincette.caller", "pincette.note"
"""Places in an ASGI scope: who asks, and what of."""
KEY = HTTPBearer(
    scheme_name="key",
    auto_error=False,
    description="A key of `pincette key add`, wanted where the supervisor has any. Scopes: "
    + "; ".join(f"`{name}`: {text}" for name, text in MEANINGS.items()),
)
SESSION = APIKeyCookie(
    name=COOKIE,
    scheme_name="session",
    auto_error=False,
    description="Of a page that was signed in with a key by `POST /api/v1/session`",
)


def caller_of(scope: AsgiScope, gate: Gate) -> Caller:
    """Who sends a request; found once, and kept in its scope."""
    known = scope.get(CALLER)
    if known is None:
        headers, client = Headers(scope=scope), scope.get("client")
        scheme, shown = get_authorization_scheme_param(headers.get("authorization"))
        address = "unknown" if client is None else str(client[0])
        # What is shown in another way opens nothing, and no cookie is looked at then.
        key = (shown if scheme.lower() == "bearer" else "") if scheme else None
        known = gate.known(address, key, HTTPConnection(scope).cookies.get(COOKIE))
        scope[CALLER] = known
    return known


def gate_of(request: Request) -> Gate:
    """Who lets callers in."""
    return request.app.state.gate


# On the event loop: in a thread of the pool an emergency stop would wait for one.
async def _admitted(
    request: Request,
    needed: SecurityScopes,
    _key: Annotated[HTTPAuthorizationCredentials | None, Security(KEY)],
    _session: Annotated[str | None, Security(SESSION)],
) -> Caller:
    caller = caller_of(request.scope, gate_of(request))
    admit(caller, needed.scopes[0])  # pyright: ignore[reportArgumentType]  as _needs gives it
    return caller


def _needs(scope: Scope) -> Any:
    return Security(_admitted, scopes=[scope])


OBSERVE, OPERATE, ADMIN = _needs("observe"), _needs("operate"), _needs("admin")


async def _known(request: Request) -> Caller:
    return caller_of(request.scope, gate_of(request))


Known = Annotated[Caller, Depends(_known)]
"""Who asks, whether or not they may do anything."""


async def _note(request: Request) -> Callable[[str], None]:
    def note(text: str) -> None:
        request.scope[NOTE] = text

    return note


Note = Annotated[Callable[[str], None], Depends(_note)]
"""Says in the audit log what a request asks for, where its path does not."""
