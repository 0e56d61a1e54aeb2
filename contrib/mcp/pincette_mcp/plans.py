"""Tokens of feasible plans: what may be gripped, once, for a limited time."""

import secrets
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

VALID_S = 120.0
MOST = 100


class NoPlanError(Exception):
    """A token that names no plan that may be run."""


@dataclass(frozen=True, slots=True)
class _Kept:
    fields: dict[str, Any]
    until_s: float


class Plans:
    """Feasible plans by their tokens."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._kept: dict[str, _Kept] = {}

    def keep(self, fields: dict[str, Any]) -> str:
        """Return the token of what has been planned."""
        now_s = self._clock()
        self._kept = {token: one for token, one in self._kept.items() if one.until_s > now_s}
        if len(self._kept) >= MOST:
            del self._kept[next(iter(self._kept))]
        token = secrets.token_urlsafe(16)
        self._kept[token] = _Kept(fields, now_s + VALID_S)
        return token

    def take(self, token: str) -> dict[str, Any]:
        """Return what was planned; the token is then no more. Raises NoPlanError."""
        kept = self._kept.pop(token, None)
        if kept is None or kept.until_s <= self._clock():
            raise NoPlanError(
                f"no-plan: this token is used, older than {VALID_S:g} s, or was never given; call "
                "plan_grip, and grip with the token of a feasible plan"
            )
        return kept.fields
