"""An emergency stop over REST with the standard library alone, so that it begins at once.

A reply counts only if it is a supervisor's own, and if its certificate is trusted.
"""

import json
import os
import ssl
from collections.abc import Mapping
from dataclasses import dataclass, replace
from http.client import HTTPConnection, HTTPException, HTTPSConnection
from ipaddress import ip_address
from pathlib import Path
from typing import Any, cast
from urllib.parse import quote, urlsplit

from pincette.core.listening import account_name, listener_uid

API = "/api/v1"
MOST_BYTES = 1_000_000
"""Size limit of a reply, in bytes."""
UNCONFIRMED = "urn:pincette:problem:estop-unconfirmed"
ESTOP_CAUSE = "estop"
"""Cause of a trip by an emergency stop: the text of ``Cause.ESTOP`` over REST."""
KEY = "Authorization"
DEFAULT_PORTS: Mapping[str, int] = {"http": 80, "https": 443}
FIRST_USER, UNKNOWN_UID = 1000, 65534
"""First user id of accounts of people (Linux), and the user id that the kernel shows for an account
that a namespace does not know."""


class RestStopError(Exception):
    """Error if no rig has confirmed the stop; the text gives the reason."""


@dataclass(frozen=True, slots=True)
class RestStop:
    """Rigs whose stop a supervisor has confirmed."""

    stopped: tuple[str, ...]
    """Names of the stopped rigs."""
    unconfirmed: tuple[str, ...] = ()
    """Names of the rigs whose actuator has not confirmed."""
    notes: tuple[str, ...] = ()
    """Information that could not be used, each with the reason."""
    proven: bool = False
    """True if a certificate proved the identity of the supervisor. Plain HTTP proves nothing."""
    foreign_account: str = ""
    """Account of the program that replied, if it is another user of this machine."""


@dataclass(frozen=True, slots=True)
class _Reply:
    """Reply to a request: the status, the JSON body or None, and the sender."""

    status: int
    tree: object
    foreign_account: str


def stop_over_rest(
    url: str, only: str | None, headers: Mapping[str, str], authority: Path | None, timeout_s: float
) -> RestStop:
    """Stop one rig of a supervisor, or all of them.

    The address may be any that a person copies: see ``root_of``. If the supervisor's certificate is
    not trusted, the stop is sent without the headers, and nothing counts as confirmed. Plain HTTP
    does not prove which program replies. The key is therefore not sent over it; a stop needs no
    key.

    Raises
    ------
    RestStopError
        Nothing is confirmed.
    """
    url = root_of(url)
    path = f"{API}/estop" if only is None else f"{API}/rigs/{quote(only, safe='')}/estop"
    notes: list[str] = []
    context: ssl.SSLContext | None = None
    if not url.lower().startswith("https:"):
        headers = _without_key(headers)
    else:
        try:
            context = ssl.create_default_context(cafile=authority)
        except OSError as error:
            notes.append(f"authority {authority}: {error}")
            context = ssl.create_default_context()
    try:
        reply = _posted(url, path, headers, context, timeout_s)
        if reply.status in (401, 403) and KEY in headers:
            reply = _posted(url, path, _without_key(headers), context, timeout_s)
    except ssl.SSLCertVerificationError as error:
        open_to_all = ssl.create_default_context()
        open_to_all.check_hostname, open_to_all.verify_mode = False, ssl.CERT_NONE
        reply = _posted(url, path, {}, open_to_all, timeout_s)
        raise RestStopError(
            "; ".join(
                [
                    *notes,
                    f"{url}: the stop was sent and answered with status {reply.status}, but "
                    f"the certificate is not trusted ({error.verify_message}): name the "
                    "authority's file with --authority",
                ]
            )
        ) from error
    return replace(
        _confirmed(url, only, reply.status, reply.tree),
        notes=tuple(notes),
        proven=context is not None,
        foreign_account=reply.foreign_account,
    )


def is_same_place(one: str, other: str) -> bool:
    """Return whether two addresses mean the same port of the same machine."""
    try:
        parts = [urlsplit(root_of(url)) for url in (one, other)]
        ports = {part.port or DEFAULT_PORTS.get(part.scheme) for part in parts}
    except ValueError:
        return False
    hosts = {"" if _is_loopback(part.hostname or "") else part.hostname for part in parts}
    return len(hosts) == len(ports) == 1


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def _without_key(headers: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in headers.items() if name != KEY}


def _foreign_account(line: HTTPConnection) -> str:
    """Return the account of the program behind a connection to this machine; "" if it is this
    user's.

    System accounts are trusted.
    """
    host, port = line.sock.getpeername()[:2]
    uid = listener_uid(host, port) if _is_loopback(host) else None
    if uid is None or uid in (os.geteuid(), UNKNOWN_UID) or uid < FIRST_USER:
        return ""
    return account_name(uid)


def root_of(url: str) -> str:
    """Return the address of a supervisor from any address that a person copies.

    The address may lack the scheme. It may be that of the REST interface, of one of its resources,
    or of the page as shown by a browser, with a query or a fragment.
    """
    text = url.strip()
    text = text if "://" in text else f"http://{text}"
    text = text.partition("#")[0].partition("?")[0]
    base, found, rest = text.rpartition(API)
    if found and (not rest or rest.startswith("/")):
        text = base
    folder, _, page = text.rpartition("/")
    is_page = page.endswith((".html", ".htm")) and not folder.endswith("/")
    return (folder if is_page else text).rstrip("/")


def _posted(
    url: str,
    path: str,
    headers: Mapping[str, str],
    context: ssl.SSLContext | None,
    timeout_s: float,
) -> _Reply:
    """Send a POST request without a body."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise RestStopError(f"{url} is not an address of a supervisor ({error})") from error
    if parts.scheme not in ("http", "https") or not host:
        raise RestStopError(
            f"{url} is not an address of a supervisor, such as http://127.0.0.1:8000"
        )
    if context is not None:
        line = HTTPSConnection(host, port, timeout=timeout_s, context=context)
    else:
        line = HTTPConnection(host, port, timeout=timeout_s)
    try:
        line.connect()
        foreign = "" if context else _foreign_account(line)
        line.request("POST", parts.path.rstrip("/") + path, headers=dict(headers))
        answer = line.getresponse()
        content = answer.read(MOST_BYTES)
    except ssl.SSLCertVerificationError:
        raise
    except (OSError, HTTPException, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else repr(error)
        raise RestStopError(f"{url}: no answer ({why})") from error
    finally:
        line.close()
    try:
        return _Reply(answer.status, json.loads(content), foreign)
    except (ValueError, RecursionError):
        return _Reply(answer.status, None, foreign)


def _confirmed(url: str, only: str | None, status: int, tree: object) -> RestStop:
    answer = cast("dict[str, Any]", tree) if isinstance(tree, dict) else {}
    if status == 503 and answer.get("type") == UNCONFIRMED:
        missing = _names(answer.get("unconfirmed")) or (() if only is None else (only,))
        if missing:
            return RestStop(_names(answer.get("stopped")), missing)
    if status != 200:
        words = answer.get("detail") or answer.get("title") or "without a reason"
        raise RestStopError(f"{url} answers with status {status}: {words}")
    entries: object = answer.get("rigs") if only is None else [answer]
    stopped = (
        [_name(entry) for entry in cast("list[object]", entries)]
        if isinstance(entries, list)
        else []
    )
    if not stopped or not all(stopped) or (only is not None and stopped != [only]):
        raise RestStopError(f"{url} answers with status 200, but not like a supervisor")
    return RestStop(tuple(stopped))


def _names(found: object) -> tuple[str, ...]:
    return tuple(map(str, cast("list[object]", found))) if isinstance(found, list) else ()


def _name(entry: object) -> str:
    """Return the name of the rig that an entry confirms, or an empty text."""
    one = cast("dict[str, Any]", entry) if isinstance(entry, dict) else {}
    confirmed = one.get("cause") == ESTOP_CAUSE and one.get("acknowledged") is True
    return one["rig"] if confirmed and isinstance(one.get("rig"), str) else ""
