"""Tokens of feasible plans: permissions to grip, once, for a limited time.

A token holds the plan and a signature. The secret of the signature is a file of the account, so
that a token is also valid for the server that replaces an ended one. If the protocol has sessions,
a token is valid for its session only.
"""

import hmac
import json
import secrets
from base64 import urlsafe_b64decode, urlsafe_b64encode
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

from pincette.core.files import replace_file
from pincette.core.user_folders import config_folder

VALID_S = 120.0
SIGNATURE_BYTES = 12
SECRET_BYTES = 32
SECRET = "pincette/mcp-tokens"
"""File of the secret, in the account's folder of settings."""
KEY = "pincette/mcp-key"
"""File of the key that callers over HTTP send, in the account's folder of settings."""


class NoPlanError(Exception):
    """Error for a token that contains no plan, or a plan that may not be run any more."""

    def __init__(self, why: str) -> None:
        words = f"no-plan: this token {why}; plan again, and use the token of that plan"
        super().__init__(words)


class Plan(NamedTuple):
    """Feasible plan, as its token contains it."""

    id: str
    """Name of the plan, used as label and Idempotency-Key of its job."""
    rig: str
    force_mN: float
    hold_s: float | None
    """Hold time in s; None: until the release."""
    until_s: float
    """Time of the system clock at which the token expires, in s."""
    session: str
    """Session of the protocol; empty if it has none."""
    series: dict[str, Any] | None = None
    """Request for a series; None for a grip."""


class Tokens:
    """Signs plans, and accepts each of them once."""

    def __init__(self, secret: bytes, clock: Callable[[], float]) -> None:
        self._secret, self._clock = secret, clock
        self._taken: set[str] = set()

    def of(
        self,
        rig: str,
        force_mN: float,
        hold_s: float | None,
        session: str,
        series: dict[str, Any] | None = None,
    ) -> str:
        """Return the token of a plan."""
        until_s = round(self._clock() + VALID_S, 1)
        plan = Plan(secrets.token_urlsafe(9), rig, force_mN, hold_s, until_s, session, series)
        text = json.dumps(plan, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 3)  # pad to groups of three bytes, so that base64 needs no =
        return f"{_text(text)}.{_text(self._signature(text))}"

    def take(self, token: str, session: str) -> Plan:
        """Return the plan of a token, and mark the token as used. Raises NoPlanError."""
        text, _, signature = token.partition(".")
        try:
            content, signed = urlsafe_b64decode(text), urlsafe_b64decode(signature)
        except ValueError:
            content = signed = b""
        if not hmac.compare_digest(signed, self._signature(content)):
            raise NoPlanError("was never issued")
        plan = Plan(*json.loads(content))
        if plan.session != session:
            raise NoPlanError("belongs to another session")
        if plan.until_s <= self._clock():
            raise NoPlanError(f"is older than {VALID_S:g} s")
        if plan.id in self._taken:
            raise NoPlanError("was already used")
        self._taken.add(plan.id)
        return plan

    def _signature(self, content: bytes) -> bytes:
        return hmac.digest(self._secret, content, sha256)[:SIGNATURE_BYTES]


def account_secret() -> bytes:
    """Return the secret of the account, or one for this process only if it cannot be stored."""
    made = secrets.token_bytes(SECRET_BYTES)
    kept = account_file(SECRET, made)
    return made if kept is None else kept.read_bytes()


def account_file(name: str, made: bytes) -> Path | None:
    """Return a file of the account's settings, created if missing; None if that is impossible.

    A new file contains ``made``. A file of another length counts as missing.
    """
    folder = config_folder()
    if folder is None:
        return None
    path = folder / name
    try:
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, made, 0o600)
        return path if len(path.read_bytes()) == len(made) else None
    except OSError:
        return None


def _text(content: bytes) -> str:
    return urlsafe_b64encode(content).decode()
