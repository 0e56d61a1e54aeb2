"""Dependencies of routes: the rigs, the caller and its scope, and the request's headers.

All are coroutines, so that an emergency stop never waits for a thread of the pool.
"""

import asyncio
import re
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any
from urllib.parse import unquote

from fastapi import Depends, Header, Query, Request, Security
from fastapi.security import (
    APIKeyCookie,
    HTTPAuthorizationCredentials,
    HTTPBearer,
    SecurityScopes,
)
from fastapi.security.utils import get_authorization_scheme_param
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import Scope as AsgiScope

from pincette.api.access import MEANINGS, SCOPES, Scope
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import Authenticator, Caller, require_scope
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.journal.store import Store

LARGEST = 2**63 - 1
"""Largest number that a column of the database can store."""
NAME_LENGTH = 200
Named = Annotated[str | None, Query(max_length=NAME_LENGTH)]
"""Name by which a list is filtered."""
PageSize = Annotated[int, Query(ge=1, le=500)]
"""Number of entries of a list in one response."""

# Contents of responses other than JSON, as the OpenAPI document describes them.

Content = dict[str, dict[str, Any]]
"""Schema of a body by its media type."""
_BYTES = {"schema": {"type": "string", "format": "binary"}}
CSV: Content = {"text/csv; charset=utf-8": {"schema": {"type": "string"}}}
BINARY: Content = {"application/octet-stream": _BYTES}
"""Content of Parquet files; generated clients have bytes for this media type."""
OBJECT: Content = {"application/json": {"schema": {"type": "object"}}}
PNG: Content = {"image/png": _BYTES}

# The cookie of a signed-in page.
#
# Cookies ignore ports, so the name contains the supervisor's identifier: a browser that is signed
# in to two supervisors of one host stays signed in to both. Over TLS the name has the prefix
# ``__Host-``. A page over plain HTTP cannot replace a secure cookie of the same name.

COOKIE = "pincette_session"
SECURE = "__Host-"


def cookie_name(supervisor: str) -> str:
    """Return the name of the cookie over plain HTTP."""
    return f"{COOKIE}_{supervisor}" if supervisor else COOKIE


def session_cookies(scope: AsgiScope, supervisor: str) -> list[str]:
    """Return the values of the cookies of one supervisor that a request sent."""
    cookies, name = HTTPConnection(scope).cookies, cookie_name(supervisor)
    return [cookies[one] for one in (SECURE + name, name) if one in cookies]


def set_cookie(response: Response, scope: AsgiScope, supervisor: str, value: str) -> None:
    """Sign a page in by a cookie that scripts cannot read and that other sites cannot send."""
    secure = _is_secure(HTTPConnection(scope))
    name = (SECURE if secure else "") + cookie_name(supervisor)
    response.set_cookie(name, value, path="/", httponly=True, samesite="strict", secure=secure)


def _is_secure(connection: HTTPConnection) -> bool:
    """Return whether the client is connected over TLS, which may end at a proxy."""
    # Every browser sends the address of its page; other programs do not, but the proxy may state
    # how it was reached. A client that forges either value harms only its own cookie.
    forwarded = connection.headers.get("x-forwarded-proto", "").partition(",")[0].strip()
    page = connection.headers.get("origin") or forwarded or str(connection.url.scheme)
    return page.lower().startswith("https")


def delete_cookies(response: Response, scope: AsgiScope, supervisor: str) -> None:
    """Sign a page out: delete the cookies that it has sent."""
    cookies, name = HTTPConnection(scope).cookies, cookie_name(supervisor)
    for one, secure in ((SECURE + name, True), (name, False)):
        if one in cookies:
            response.delete_cookie(one, path="/", httponly=True, samesite="strict", secure=secure)


CALLER, NOTE = "pincette.caller", "pincette.note"
SHARE, HELD = "pincette.share", "pincette.held"
"""Keys of an ASGI scope. ``CALLER``: the caller. ``NOTE``: the note for the audit log. ``SHARE``:
the limits for a request to the actions of a job, which apply unless it is a stop. ``HELD``: present
while the rejection of the request is being delayed.
"""
DISCONNECT_S = 10.0
"""Time within which the event loop must report whether a caller has disconnected, in s."""
OPERATOR_LENGTH, KEY_LENGTH = 960, 255
PRINTABLE = r"^[ -~]+$"
NOT_BLANK = r"[^\s]"
BEARER = HTTPBearer(
    scheme_name="key",
    auto_error=False,
    description="A key made by `pincette key add`, required if the supervisor has any. Scopes: "
    + "; ".join(f"`{name}`: {text}" for name, text in MEANINGS.items()),
)
SESSION = APIKeyCookie(
    name=COOKIE,
    scheme_name="session",
    auto_error=False,
    description="Cookie that `POST /api/v1/session` sets. Its name ends with `_` and the "
    "supervisor's identifier, and over TLS it begins with `__Host-`",
)
_TAG = re.compile(r'(?:W/)?"([^"]*)-([0-9]{1,18})"')


def caller_of(scope: AsgiScope, authenticator: Authenticator) -> Caller:
    """Return the sender of a request; it is identified once and stored in the ASGI scope."""
    known = scope.get(CALLER)
    if known is None:
        known = scope[CALLER] = _identified(scope, authenticator)
    return known


def _identified(scope: AsgiScope, authenticator: Authenticator) -> Caller:
    headers, client = Headers(scope=scope), scope.get("client")
    scheme, shown = get_authorization_scheme_param(headers.get("authorization"))
    address = "unknown" if client is None else str(client[0])
    # A scheme other than Bearer never authenticates; the cookie is then ignored.
    key = (shown if scheme.lower() == "bearer" else "") if scheme else None
    callers = [
        authenticator.identify(address, key, cookie)
        for cookie in session_cookies(scope, authenticator.supervisor) or (None,)
    ]
    return next((caller for caller in callers if caller.scope is not None), callers[0])


def decoded(header: str) -> str:
    """Return a header value of any alphabet: plain UTF-8, or percent-encoded as in a URL."""
    with suppress(UnicodeError):
        header = header.encode("latin-1").decode()
    with suppress(UnicodeError):
        header = unquote(header, errors="strict")
    return "".join(sign if sign.isprintable() else "\N{REPLACEMENT CHARACTER}" for sign in header)


def label_of(scope: AsgiScope) -> str:
    """Return the label in ``X-Operator``; empty if there is none."""
    return decoded(Headers(scope=scope).get("x-operator", "")[:OPERATOR_LENGTH]).strip()


async def _access(request: Request) -> Access:
    return request.app.state.access


async def _rigs(request: Request) -> Rigs:
    return request.app.state.rigs


AccessState = Annotated[Access, Depends(_access)]
AllRigs = Annotated[Rigs, Depends(_rigs)]


async def _store(rigs: AllRigs) -> Store:
    return rigs.store


async def _manager(rig: str, rigs: AllRigs) -> JobManager:
    return rigs.get(rig)


async def _caller(request: Request, access: AccessState) -> Caller:
    return caller_of(request.scope, access.authenticator)


Journal = Annotated[Store, Depends(_store)]
Manager = Annotated[JobManager, Depends(_manager)]
"""Job manager of the rig in the path."""
AnyCaller = Annotated[Caller, Depends(_caller)]
"""Caller of the request, with or without any right."""


def authorize(request: Request, needed: Collection[str]) -> None:
    """Raise ProblemError unless the caller's scope includes all that are needed."""
    access: Access = request.app.state.access
    caller = caller_of(request.scope, access.authenticator)
    for scope in SCOPES:
        if scope in needed:
            require_scope(caller, scope)


async def _authorized(
    request: Request,
    needed: SecurityScopes,
    _key: Annotated[HTTPAuthorizationCredentials | None, Security(BEARER)],
    _session: Annotated[str | None, Security(SESSION)],
) -> None:
    authorize(request, needed.scopes)


def _needs(scope: Scope) -> Any:
    return Security(_authorized, scopes=[scope])


OBSERVE, PROPOSE = _needs("observe"), _needs("propose")
OPERATE, ADMIN = _needs("operate"), _needs("admin")
"""Dependencies of a route that requires a scope."""


async def _permitted(request: Request, access: AccessState) -> Callable[[], bool]:
    def permitted() -> bool:
        return _identified(request.scope, access.authenticator).scope is not None

    return permitted


Permitted = Annotated[Callable[[], bool], Depends(_permitted)]
"""Function that returns True while the caller's key or session is valid; a stream must check this
repeatedly.
"""


async def _sender(request: Request, caller: AnyCaller) -> str:
    return caller.signed(label_of(request.scope))


async def _operator(
    caller: AnyCaller,
    x_operator: Annotated[
        str | None,
        Header(
            description="name of the person or program, stored with the action; if keys are used, "
            "stored in addition to the name of the key; any alphabet, in UTF-8 or "
            "percent-encoded",
            min_length=1,
            max_length=OPERATOR_LENGTH,
            pattern=NOT_BLANK,
        ),
    ] = None,
) -> str:
    label = decoded(x_operator or "")
    return caller.signed(label)


Sender = Annotated[str, Depends(_sender)]
"""Name of the key, label or address of the sender.

Never rejected, since an emergency stop must not be.
"""
Operator = Annotated[str, Depends(_operator)]
"""Name of the key combined with the header ``X-Operator``; the address if both are missing."""


async def _supervisor(access: AccessState) -> str:
    return access.authenticator.supervisor


SupervisorId = Annotated[str, Depends(_supervisor)]
"""Identifier of the supervisor, by which a client recognises its replies."""


async def _note(request: Request) -> Callable[[str], None]:
    def note(text: str) -> None:
        request.scope[NOTE] = text

    return note


Note = Annotated[Callable[[str], None], Depends(_note)]
"""Function that adds to the audit log what is requested, if the path does not show it."""


async def _hung_up(request: Request) -> Callable[[], bool]:
    loop = asyncio.get_running_loop()

    def hung_up() -> bool:
        disconnected = asyncio.run_coroutine_threadsafe(request.is_disconnected(), loop)
        return disconnected.result(DISCONNECT_S)

    return hung_up


HungUp = Annotated[Callable[[], bool], Depends(_hung_up)]
"""Function that returns True once the caller has disconnected.

It must be called in a thread of the pool.
"""

CLAIM_TOKEN = r"^[!-~]{16,200}$"
ClaimToken = Annotated[
    str | None,
    Header(
        alias="X-Claim",
        description="secret of the caller's claim on a rig, chosen by the caller",
        pattern=CLAIM_TOKEN,
    ),
]


_TRACE = re.compile(r"00-(?!0{32})[0-9a-f]{32}-(?!0{16})[0-9a-f]{16}-[0-9a-f]{2}")
TraceParent = Annotated[
    str | None,
    Header(
        alias="traceparent",
        description="trace context (W3C), stored with the job; a context that is invalid is "
        "ignored",
    ),
]


@dataclass(frozen=True, slots=True)
class Asker:
    """Caller who requests a job, and whether it is still connected."""

    by: str
    claim: str | None
    note: Callable[[str], None]
    gone: Callable[[], bool]
    trace: str | None = None
    """Valid trace context of the request; None without one."""


async def _asker(
    by: Operator,
    note: Note,
    gone: HungUp,
    claim: ClaimToken = None,
    traceparent: TraceParent = None,
) -> Asker:
    valid = traceparent is not None and _TRACE.fullmatch(traceparent)
    return Asker(by, claim, note, gone, traceparent if valid else None)


Asking = Annotated[Asker, Depends(_asker)]
"""Sender of a request that starts something."""
IdempotencyKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        description="the same key and request create one job, however often they are sent",
        min_length=1,
        max_length=KEY_LENGTH,
        pattern=PRINTABLE,
    ),
]

IfNoneMatch = Annotated[
    str | None, Header(description="answer 304 where the job still has this ETag")
]


def etag(job: str, revision: int) -> str:
    """Return the ETag of a job; it is weak, since progress does not change it."""
    return f'W/"{job}-{revision}"'


def matched_revision(job: str, header: str | None) -> int | None:
    """Return the job revision in ``If-None-Match``; None if there is none."""
    for name, revision in _TAG.findall(header or ""):
        if name == job:
            return int(revision)
    return None
