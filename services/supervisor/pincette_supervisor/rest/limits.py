"""Limits of request rate, concurrency and body; an emergency stop is exempt from the first two.

The target of each request is normalised before any limit, route or check reads it.
"""

import asyncio
import posixpath
import re
from collections import Counter
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from math import ceil
from random import uniform
from time import monotonic
from typing import Any, Literal
from urllib.parse import urlsplit

from fastapi import Request
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pincette_supervisor import problems
from pincette_supervisor.access.access import TokenBuckets
from pincette_supervisor.access.authentication import Authenticator, Caller
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import HELD, SHARE, caller_of

_ABSOLUTE = re.compile(r"[a-z][a-z0-9+.-]*://", re.IGNORECASE)
_ESTOP = re.compile(r"/api/v1/(?:rigs/[^/]+/)?estop")
_AFTER_PATH = re.compile("[?#;]")
_REQUEST_LINE = re.compile(rb"\s*post[ \t]+(\S+)", re.IGNORECASE)
_FROM_BROWSER = re.compile(rb"^(?:origin|sec-fetch-[a-z]+)[ \t]*:", re.IGNORECASE | re.MULTILINE)
_HEAD_END = re.compile(rb"\r?\n\r?\n")
JOB_STOPS = ("/actions", "/stop")
"""Path suffixes below ``/jobs`` and ``/series`` that stop a job."""
STOPPED = ("/jobs/", "/series/")


def estop_path(method: str, path: str) -> str | None:
    """Return the emergency stop path that a request means; None for any other request.

    A stop is accepted for every spelling of its path: repeated or trailing slashes, dot segments,
    upper case, spaces, and a query that was percent-encoded into the path. Other routes accept
    their exact path only.
    """
    if method.upper() != "POST":
        return None
    segments = _AFTER_PATH.split(path, 1)[0].split("/")
    plain = "/".join(segment.strip() for segment in segments).lower()
    plain = posixpath.normpath("/" + plain.lstrip("/"))
    return plain if _ESTOP.fullmatch(plain) else None


def estop_of_malformed(head: bytes) -> bytes | None:
    """Return a minimal valid head for a stop whose own head is invalid HTTP; otherwise None.

    HTTP/1.1 without ``Host`` is the usual case. A head with the headers of a browser is still
    rejected, because the check of its origin could not be trusted.
    """
    line = _REQUEST_LINE.match(head)
    if line is None or _HEAD_END.search(head) is None or _FROM_BROWSER.search(head):
        return None
    path = _origin_form(line[1].decode("latin-1"))[1]
    found = estop_path("POST", _percent_decoded(path))
    return None if found is None else b"POST %b HTTP/1.0\r\n\r\n" % found.encode("latin-1")


def is_stop(head: bytes) -> bool:
    """Return whether the first line shows a request that stops a rig or a job."""
    line = _REQUEST_LINE.match(head)
    if line is None:
        return False
    path = _origin_form(line[1].decode("latin-1"))[1]
    return path.endswith(JOB_STOPS) or estop_path("POST", _percent_decoded(path)) is not None


def _percent_decoded(path: str) -> str:
    return re.sub("%([0-9a-fA-F]{2})", lambda found: chr(int(found[1], 16)), path)


def _origin_form(target: str) -> tuple[str | None, str]:
    """Split an absolute-form target into authority and path; the authority may be None."""
    if not _ABSOLUTE.match(target):
        return None, target
    parts = urlsplit(target)
    return parts.netloc, parts.path or "/"


class NormalTarget:
    """ASGI middleware that converts absolute-form targets and the spellings of a stop."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] == "http":
            scope = _normal(scope)
        await self._app(scope, receive, send)


def _normal(scope: Scope) -> Scope:
    try:
        authority, path = _origin_form(scope["path"])
    except ValueError:  # no valid authority; no route has this path
        return scope
    if authority is not None:
        # The authority replaces Host (RFC 9112, 3.2.2).
        others = [(name, value) for name, value in scope["headers"] if name != b"host"]
        host = (b"host", authority.encode("utf-8"))
        scope = {**scope, "path": path, "raw_path": path.encode(), "headers": [host, *others]}
    estop = estop_path(scope["method"], path)
    if estop is not None:
        scope = {**scope, "method": "POST", "path": estop, "raw_path": estop.encode()}
    return scope


Kind = Literal["short", "long"]
"""Kind of request: ``long`` is a stream or a long poll, which waits; ``short`` is any other one."""
AT_ONCE: Mapping[Kind, int] = {"short": 512, "long": 256}
"""Largest number of concurrent requests of all clients, by kind; beyond it, 503."""
OF_ONE: Mapping[Kind, int] = {"short": 128, "long": 64}
"""Largest number of concurrent requests of one client, by kind; beyond it, 429. A request counts
while its body arrives.
"""
STREAMED = ("/events", "/live")
LONG_POLL = b"wait="
LONG_PER_S, LONG_BURST = 40.0, 100.0
"""Rate and burst of the long requests of one client. A long poll of a finished job returns at once,
so a flood of them would use up the rate of all other requests."""
PATIENCE_S = 1.0
"""Longest time in s for which a request waits after its client has exceeded its rate; beyond it,
429. This gives all clients that share an address without keys a chance to be served."""
HELD_S: Mapping[Kind, float] = {"short": 1.0, "long": 5.0}
"""Time in s for which a rejection with 429 is delayed, by kind of request, so that a client that
retries at once does not keep the server busy with rejections.
"""
SPREAD = (0.75, 1.25)
"""Range of the random factor of ``HELD_S``, so that clients that were rejected together do not
retry together.
"""
SEND_S = 30.0
"""Longest time that a client may take to read one block of a response, in s."""
ESTOP = "/estop"
SMALL_BYTES, LARGE_BYTES = 16_384, 262_144
"""Largest body of a route, in bytes. The larger limit applies where a request has points, labels or
notes: a path of 200 points takes some 20 kB, and 4000 characters of notes up to 48 kB."""
MOST_BYTES = "x-max-bytes"
"""Extension of the OpenAPI document with which a route states the limit of its body."""
LARGE: dict[str, Any] = {MOST_BYTES: LARGE_BYTES}
"""``openapi_extra`` of a route whose body may contain points, labels or notes."""
BODY_S = 10.0
"""Longest time from the head of a request to the end of its body, in s."""


class Shares:
    """Counts the concurrent requests, by client and kind."""

    def __init__(self) -> None:
        self._all: Counter[Kind] = Counter()
        self._of_one: Counter[tuple[Kind, str]] = Counter()

    @contextmanager
    def taken(self, kind: Kind, client: str, clients: int = 1) -> Generator[None]:
        """Count a request within the ``with`` block; raises ProblemError if there are too many.

        ``clients`` is the number of clients that share one limit.
        """
        place: tuple[Kind, str] = (kind, client)
        most = clients * OF_ONE[kind]
        if self._of_one[place] >= most:
            why = f"{client} has {most} {kind} requests in progress, the maximum"
            raise _refused(429, why, 5.0 if kind == "long" else 1.0)
        if self._all[kind] >= AT_ONCE[kind]:
            why = f"{AT_ONCE[kind]} {kind} requests are in progress, the maximum"
            raise _refused(503, why, 1.0)
        self._all[kind] += 1
        self._of_one[place] += 1
        try:
            yield
        finally:
            self._all[kind] -= 1
            self._of_one[place] -= 1
            if not self._of_one[place]:
                del self._of_one[place]


class RateLimit:
    """Rejects requests beyond the rate and the concurrency limits, with ``Retry-After``.

    A client is a key, or an address if no valid key is sent. Emergency stops are exempt, and so are
    the actions of a job with a valid key: its route applies the limits to all but stops.
    """

    def __init__(
        self,
        app: ASGIApp,
        authenticator: Authenticator,
        clock: Callable[[], float] = monotonic,
        buckets: TokenBuckets | None = None,
        clients_per_address: int = 1,
    ) -> None:
        """Create the limits.

        ``clients_per_address`` multiplies the limits of an address without a key.
        """
        self._clients_per_address = clients_per_address
        self._app, self._authenticator, self._clock = app, authenticator, clock
        self._buckets: Mapping[Kind, TokenBuckets] = {
            "short": buckets or TokenBuckets(),
            "long": TokenBuckets(LONG_PER_S, LONG_BURST),
        }
        self._shares = Shares()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http" or is_estop(scope):
            await self._app(scope, receive, send)
            return
        caller = caller_of(scope, self._authenticator)
        send = _with_send_timeout(send)
        if caller.scope is not None and _may_stop_job(scope):
            scope[SHARE] = lambda: self._taken_at_once("short", caller)
            await self._app(scope, receive, send)
            return
        kind = _kind(scope)
        try:
            await asyncio.sleep(self._wait_s(kind, caller, PATIENCE_S))
            with self._shares.taken(kind, caller.client, self._clients(caller)):
                await self._app(scope, receive, send)
        except ProblemError as refusal:  # raised by the limits; the application handles its own
            scope[HELD] = True
            await asyncio.sleep(HELD_S[kind] * uniform(*SPREAD))
            await problems.response_of(refusal)(scope, receive, send)

    @contextmanager
    def _taken_at_once(self, kind: Kind, caller: Caller) -> Generator[None]:
        self._wait_s(kind, caller, 0.0)
        with self._shares.taken(kind, caller.client, self._clients(caller)):
            yield

    def _clients(self, caller: Caller) -> int:
        return self._clients_per_address if caller.name is None else 1

    def _wait_s(self, kind: Kind, caller: Caller, patience_s: float) -> float:
        """Count a request and return its waiting time, in s.

        Raises ProblemError if it is too long.
        """
        clients = self._clients(caller)
        wait_s = self._buckets[kind].wait_s(caller.client, self._clock(), patience_s, clients)
        if wait_s > patience_s:
            raise _refused(429, f"{caller.client} sends requests too often", wait_s)
        return wait_s


def is_estop(scope: Scope) -> bool:
    """Return whether a request is an emergency stop."""
    return scope["method"] == "POST" and scope["path"].endswith(ESTOP)


def _may_stop_job(scope: Scope) -> bool:
    path: str = scope["path"]
    below = any(part in path for part in STOPPED)
    return scope["method"] == "POST" and below and path.endswith(JOB_STOPS)


def _kind(scope: Scope) -> Kind:
    if scope["method"] != "GET":
        return "short"
    waits = scope["path"].endswith(STREAMED) or LONG_POLL in scope.get("query_string", b"")
    return "long" if waits else "short"


def _refused(status: int, why: str, wait_s: float) -> ProblemError:
    after_s = ceil(wait_s)
    return ProblemError(
        status,
        "too-many-requests" if status == 429 else "busy",
        "Too many requests at once",
        f"{why}: send it again after {after_s} s",
        headers={"Retry-After": str(after_s)},
    )


def _with_send_timeout(send: Send) -> Send:
    """Disconnect a client that does not read its response."""

    async def timed(message: Message) -> None:
        async with asyncio.timeout(SEND_S):
            await send(message)

    return timed


async def read_body(request: Request, most_bytes: int) -> bytes:
    """Read a body; raises ProblemError if it is too large (413) or arrives too slowly (408).

    FastAPI's own ``max_body_size`` has no time limit, and replies in plain text.
    """
    announced = request.headers.get("content-length", "")
    if announced.isdecimal() and int(announced[:20]) > most_bytes:
        raise _too_large(f"{announced[:20]} bytes", most_bytes)
    body = bytearray()
    try:
        async with asyncio.timeout(BODY_S):
            async for chunk in request.stream():
                body += chunk
                if len(body) > most_bytes:
                    raise _too_large(f"more than {most_bytes} bytes", most_bytes)
    except TimeoutError as error:
        raise ProblemError(
            408,
            "body-too-slow",
            "The body is too slow",
            f"the body was not complete after {BODY_S:g} s",
            limit_s=BODY_S,
        ) from error
    except ClientDisconnect as error:
        raise ProblemError(
            400, "bad-json", "The body is incomplete", "the client closed the connection"
        ) from error
    return bytes(body)


def _too_large(size: str, most_bytes: int) -> ProblemError:
    return ProblemError(
        413,
        "body-too-large",
        "The body is too large",
        f"the body has {size}; the limit of this route is {most_bytes} bytes",
        limit_bytes=most_bytes,
    )


# Delay of rejections for an address that has had many of them recently. A client that repeats a
# rejected request at once would keep the event loop busy with rejections. A rejection that is
# delayed by a second costs the server only a timer. Accepted requests and all stops of the same
# address are not delayed.

REFUSAL_HELD_S = 1.0
"""Time for which a rejection is delayed, in s."""
PER_S, BURST = 10.0, 50.0
"""Rejections of one address that are not delayed: sustained rate, and burst."""
REFUSED = "pincette.refused"
"""Key of the ASGI scope of a request that has been rejected."""
UNKNOWN = (401, 403, 429)
"""Statuses of requests that do not count as a stop of a job, whatever their path: the sender may
not stop it, or the limits of rate and number apply."""


class Refusals:
    """Counts the rejections of each address."""

    def __init__(self, per_s: float = PER_S, burst: float = BURST) -> None:
        self._buckets = TokenBuckets(per_s, burst)

    def hold_s(self, address: str) -> float:
        """Count a rejection and return the time for which it must be delayed, in s."""
        client = Caller(address).network
        return REFUSAL_HELD_S if self._buckets.wait_s(client, monotonic()) > 0.0 else 0.0


class HeldRefusals:
    """ASGI application that delays responses with a 4xx status.

    During the delay, the request does not count towards the limits of its client.
    """

    def __init__(self, app: ASGIApp, refusals: Refusals) -> None:
        self._app, self._refusals = app, refusals

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http" or estop_path(scope["method"], scope["path"]) is not None:
            await self._app(scope, receive, send)
            return
        refusal: list[Message] = []

        async def kept(message: Message) -> None:
            start = message["type"] == "http.response.start"
            if refusal or (start and _is_refusal(scope, message["status"])):
                scope[REFUSED] = True
                refusal.append(message)
            else:
                await send(message)

        await self._app(scope, receive, kept)
        if refusal and HELD not in scope:
            client = scope.get("client")
            hold_s = self._refusals.hold_s("" if client is None else client[0])
            if hold_s:
                scope[HELD] = True
                await asyncio.sleep(hold_s)
        for message in refusal:
            await send(message)


def _is_refusal(scope: Scope, status: int) -> bool:
    stops = scope["method"] == "POST" and scope["path"].endswith(JOB_STOPS)
    return 400 <= status < 500 and (not stops or status in UNKNOWN)
