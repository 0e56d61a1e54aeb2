"""One call over REST as data: what to send, how to read the answer, and whether to repeat it."""

import math
import ssl
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar, cast
from urllib.parse import quote

import httpx
from pydantic import BaseModel, ValidationError

from pincette.api.problems import MEDIA_TYPE
from pincette.client.errors import (
    ForeignAnswerError,
    GatewayError,
    NoAnswerError,
    problem_of,
    refused,
)
from pincette.core.units import unit_of
from pincette.core.validation_wording import refusal

BASE = "/api/v1"
PATIENCE_S = 120.0
"""Default time, in s, for which a call that is safe to repeat is repeated while nobody replies.

It is longer than a supervisor needs that is restarted. Calls that are safe to repeat are those that
only read, plans, a ``start``, which has an Idempotency-Key, and everything that stops.
"""
PLANNING_S = 170.0
"""Time, in s, that a plan may take beyond other replies: searches for gains are long."""
FIRST_DELAY_S, LONGEST_DELAY_S = 0.1, 2.0
OPERATOR_MAX, KEY_MAX = 80, 200
CLAIM_MIN, CLAIM_MAX = 16, 200
UNSENT = (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout)
"""Errors after which the supervisor cannot have seen the call."""

GATEWAY = (502, 503, 504)
"""Statuses by which a proxy says that it has, or had, no line to the supervisor."""
LOOK = "look before you send it again"

T = TypeVar("T")
M = TypeVar("M", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class Call(Generic[T]):
    """One request and the reader of its answer."""

    method: str
    path: str
    read: Callable[[httpx.Response], T]
    query: Mapping[str, str | float] = field(default_factory=dict[str, str | float])
    body: Any = None
    headers: Mapping[str, str] = field(default_factory=dict[str, str])
    repeatable: bool = False
    """Whether a second call has no further effect, as when the first answer was lost."""
    kept_s: float = 0.0
    """How long the supervisor may delay its answer, in s."""
    look: str = LOOK
    """If no answer has come: how to see whether the request was accepted."""

    def details(self, timeout_s: float) -> dict[str, Any]:
        """Return arguments of ``httpx.Client.request``."""
        details: dict[str, Any] = {
            "method": self.method,
            "url": self.path,
            "params": dict(self.query),
            "headers": dict(self.headers),
            "timeout": httpx.Timeout(timeout_s, read=timeout_s + self.kept_s),
        }
        if self.body is not None:
            require_finite(self.body)
            details["json"] = self.body
        return details

    @property
    def changes(self) -> bool:
        """Whether it is to change something."""
        return self.method != "GET" and "dry_run" not in self.query

    def answer(self, response: httpx.Response) -> T:
        """Read an answer.

        Raises
        ------
        ProblemError
            The supervisor refuses.
        ForeignAnswerError
            The answer is not one of a supervisor of this version.
        """
        if response.is_error:
            raise problem_of(response)
        try:
            return self.read(response)
        except (ValidationError, ValueError) as error:
            raise ForeignAnswerError(
                f"{self.method} {response.request.url}: the answer cannot be read; what answers "
                f"there is no supervisor, or one of another version ({_unreadable(error)})"
            ) from error


class Attempts:
    """Times at which a call without an answer is repeated: soon, then less often, and bounded."""

    def __init__(
        self,
        what: str,
        *,
        repeatable: bool,
        patience_s: float,
        clock: Callable[[], float],
        look: str | None = None,
    ) -> None:
        """``look``: how to see whether a call that changes something was taken."""
        self._what, self._repeatable, self._look = what, repeatable, look
        self._patience_s, self._clock = patience_s, clock
        self._delivered = False
        self.succeeded()

    def succeeded(self) -> None:
        """Start again: the next failure is the first of a row."""
        self._delay_s, self._first_s = FIRST_DELAY_S, None

    def delay_s(self, error: httpx.TransportError) -> float:
        """How long to wait before the next attempt; raises NoAnswerError if there is none."""
        unsent = isinstance(error, (*UNSENT, httpx.UnsupportedProtocol))
        # One of several attempts is enough: the supervisor may have gone since.
        self._delivered = self._delivered or (self._look is not None and not unsent)
        if isinstance(error, httpx.UnsupportedProtocol) or not (self._repeatable or unsent):
            raise self._no_answer(error) from error
        if _is_mistrust(error):
            raise self._no_answer(error) from error
        now_s = self._clock()
        self._first_s = now_s if self._first_s is None else self._first_s
        left_s = self._first_s + self._patience_s - now_s
        if left_s <= 0.0:
            raise self._no_answer(error) from error
        delay_s, self._delay_s = self._delay_s, min(2.0 * self._delay_s, LONGEST_DELAY_S)
        return min(delay_s, left_s)

    def _no_answer(self, error: httpx.TransportError) -> NoAnswerError:
        why = str(error) or type(error).__name__
        silent = isinstance(error, httpx.ReadTimeout)
        if _is_mistrust(error):
            why += "; name the certificate of the authority that has signed this supervisor's"
        if not self._delivered:
            return NoAnswerError(f"{self._what}: no answer ({why})", silent=silent)
        words = (
            f"{self._what}: the connection broke before the answer came ({why}); the request "
            f"may or may not have been accepted: {self._look}"
        )
        return NoAnswerError(words, delivered=True, silent=silent)


def _is_mistrust(error: BaseException | None) -> bool:
    """Return whether a supervisor's certificate is not believed; that does not pass by itself."""
    while error is not None:
        if isinstance(error, ssl.SSLCertVerificationError):
            return True
        error = error.__cause__ or error.__context__
    return False


def identity_headers(
    operator: str | None, key: str | None, claim: str | None = None
) -> dict[str, str]:
    """Return headers that name the caller; raises ValueError if a header cannot carry a value."""
    headers: dict[str, str] = {}
    if operator is not None:
        if not operator.isprintable() or not operator.strip() or len(operator) > OPERATOR_MAX:
            raise ValueError(
                f"operator = {operator!r}: 1 to {OPERATOR_MAX} printable characters are wanted"
            )
        # A header carries ASCII alone; what has a meaning there is encoded, too.
        headers["X-Operator"] = quote(operator, safe=" ,;:!?()[]/@+*'&$=-_.~")
    if key is not None:
        if not _is_printable(key, KEY_MAX) or " " in key:
            # The message leaves the key out: it is a secret.
            raise ValueError(
                f"the key is not valid: 1 to {KEY_MAX} characters without blanks are wanted"
            )
        headers["Authorization"] = f"Bearer {key}"
    if claim is not None:
        if not _is_printable(claim, CLAIM_MAX) or " " in claim or len(claim) < CLAIM_MIN:
            raise ValueError(
                f"the claim's secret is not valid: {CLAIM_MIN} to {CLAIM_MAX} characters "
                "without blanks"
            )
        headers["X-Claim"] = claim
    return headers


def _is_printable(text: str, most: int) -> bool:
    return text.isascii() and text.isprintable() and 0 < len(text) <= most


def model(kind: type[M]) -> Callable[[httpx.Response], M]:
    """Return the reader of an answer that is a model; unknown fields are ignored."""
    return lambda response: kind.model_validate_json(response.content, extra="ignore")


def get(path: str, kind: type[M], **query: str | float | None) -> Call[M]:
    """Return a call that reads; members of the query that are None are left out."""
    given = {name: value for name, value in query.items() if value is not None}
    return Call("GET", path, model(kind), given, repeatable=True)


def post(path: str, kind: type[M], body: Any = None, *, repeatable: bool = False) -> Call[M]:
    """Return a call that changes something."""
    return Call("POST", path, model(kind), body=body, repeatable=repeatable)


def require_supervisor(response: httpx.Response) -> None:
    """Raise GatewayError where a proxy has answered, which knows nothing of the supervisor."""
    kind = response.headers.get("content-type", "").partition(";")[0]
    if response.status_code in GATEWAY and kind not in (MEDIA_TYPE, "application/json"):
        raise GatewayError(
            f"status {response.status_code}, without a problem document; is it a supervisor?"
        )


def require_finite(tree: Any, path: tuple[str, ...] = ()) -> None:
    """Raise InvalidRequestError for a number that JSON cannot carry: not a number, or infinite."""
    if isinstance(tree, float) and not math.isfinite(tree):
        named = next((part for part in reversed(path) if not part.isdigit()), "the value")
        unit = unit_of(named)
        words = f"{named} = {tree}{f' {unit}' if unit else ''}: must be a finite number"
        errors = [{"pointer": "".join(f"/{part}" for part in path), "message": words}]
        raise refused(422, "invalid-request", "The request cannot be used", words, errors=errors)
    if isinstance(tree, Mapping):
        for name, value in cast("Mapping[str, Any]", tree).items():
            require_finite(value, (*path, str(name)))
    elif isinstance(tree, list | tuple):
        for place, value in enumerate(cast("Sequence[Any]", tree)):
            require_finite(value, (*path, str(place)))


def content(response: httpx.Response) -> bytes:
    """Return the reader of an answer that is a file."""
    return response.content


def _unreadable(error: ValueError) -> str:
    """Return what is wrong with an answer, in words of pincette."""
    if not isinstance(error, ValidationError):
        return str(error).partition("\n")[0]
    found = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in found["loc"]) or "the answer"
    return f"{place} {refusal(found)}"
