"""Bring the target of each request into one form, before any route or check reads it."""

import posixpath
import re
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Receive, Scope, Send

_ABSOLUTE = re.compile(r"[a-z][a-z0-9+.-]*://", re.IGNORECASE)
_ESTOP = re.compile(r"/api/v1/(?:rigs/[^/]+/)?estop")
_AFTER_PATH = re.compile("[?#;]")
_REQUEST_LINE = re.compile(rb"\s*post[ \t]+(\S+)", re.IGNORECASE)
_FROM_BROWSER = re.compile(rb"^(?:origin|sec-fetch-[a-z]+)[ \t]*:", re.IGNORECASE | re.MULTILINE)
_HEAD_END = re.compile(rb"\r?\n\r?\n")
JOB_STOPS = ("/actions", "/stop")
"""Ends of the paths below ``/jobs`` that stop a job."""


def estop_path(method: str, path: str) -> str | None:
    """Return the path of the emergency stop that a request means, or None for other requests.

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
    """Return a minimal valid head for a stop whose own head is no valid HTTP; None for all else.

    HTTP/1.1 without ``Host`` is the usual case. A head with the headers of a browser is left
    refused, because the check of its origin could not be trusted.
    """
    line = _REQUEST_LINE.match(head)
    if line is None or _HEAD_END.search(head) is None or _FROM_BROWSER.search(head):
        return None
    path = _origin_form(line[1].decode("latin-1"))[1]
    found = estop_path("POST", _percent_decoded(path))
    return None if found is None else b"POST %b HTTP/1.0\r\n\r\n" % found.encode("latin-1")


def is_stop(head: bytes) -> bool:
    """Whether a request that begins so stops a rig or a job, as far as its first line tells."""
    line = _REQUEST_LINE.match(head)
    if line is None:
        return False
    path = _origin_form(line[1].decode("latin-1"))[1]
    return path.endswith(JOB_STOPS) or estop_path("POST", _percent_decoded(path)) is not None


def _percent_decoded(path: str) -> str:
    return re.sub("%([0-9a-fA-F]{2})", lambda found: chr(int(found[1], 16)), path)


def _origin_form(target: str) -> tuple[str | None, str]:
    """Split an absolute-form target into authority and path; the authority is None without one."""
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
