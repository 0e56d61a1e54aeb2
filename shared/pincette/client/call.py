"""One REST call as data: the request, the parser of its reply, and whether it may be repeated."""

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

PATIENCE_S = 120.0
"""Default time, in s, for which a repeatable call is repeated while no program replies.

It is longer than the restart of a supervisor. Repeatable are all calls that only read, plans,
``start`` (it has an Idempotency-Key), and all stops.
"""
PLANNING_S = 170.0
"""Additional time limit for the reply to a plan, in s, since a search for gains takes long."""
FIRST_DELAY_S, LONGEST_DELAY_S = 0.1, 2.0
OPERATOR_MAX, KEY_MAX = 80, 200
CLAIM_MIN, CLAIM_MAX = 16, 200
UNSENT = (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout)
"""Errors after which the supervisor cannot have received the request."""

GATEWAY = (502, 503, 504)
"""HTTP statuses with which a proxy reports that the supervisor is unreachable or was lost."""
LOOK = "check this before you send it again"

T = TypeVar("T")
M = TypeVar("M", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class Call(Generic[T]):
    """One request and the parser of its reply."""

    method: str
    path: str
    read: Callable[[httpx.Response], T]
    query: Mapping[str, str | float] = field(default_factory=dict[str, str | float])
    body: Any = None
    headers: Mapping[str, str] = field(default_factory=dict[str, str])
    repeatable: bool = False
    """True if a second call has no further effect, so that the call may be repeated after a lost
    reply.
    """
    kept_s: float = 0.0
    """Time for which the supervisor may delay its reply, in s."""
    look: str = LOOK
    """Instruction, for the case that no reply arrives, how to find out whether the request was
    accepted."""

    def details(self, timeout_s: float) -> dict[str, Any]:
        """Return the arguments for ``httpx.Client.request``."""
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
        """True if the call may change something."""
        return self.method != "GET" and "dry_run" not in self.query

    def answer(self, response: httpx.Response) -> T:
        """Parse a reply.

        Raises
        ------
        ProblemError
            The supervisor refuses the request.
        ForeignAnswerError
            The reply is not that of a supervisor of this version.
        """
        if response.is_error:
            raise problem_of(response)
        try:
            return self.read(response)
        except (ValidationError, ValueError) as error:
            raise ForeignAnswerError(
                f"{self.method} {response.request.url}: the answer cannot be read; it does "
                "not come from a supervisor, or from one of another version "
                f"({_unreadable(error)})"
            ) from error


class Attempts:
    """Schedule of repetitions of a call without a reply: at increasing intervals, up to a time
    limit.
    """

    def __init__(
        self,
        what: str,
        *,
        repeatable: bool,
        patience_s: float,
        clock: Callable[[], float],
        look: str | None = None,
    ) -> None:
        """``look``: how to find out whether a call that changes something was accepted."""
        self._what, self._repeatable, self._look = what, repeatable, look
        self._patience_s, self._clock = patience_s, clock
        self._delivered = False
        self.succeeded()

    def succeeded(self) -> None:
        """Reset the delays: the next failure counts as the first one."""
        self._delay_s, self._first_s = FIRST_DELAY_S, None

    def delay_s(self, error: httpx.TransportError) -> float:
        """Return the delay before the next attempt, in s; raises NoAnswerError when the time is
        over.
        """
        unsent = isinstance(error, (*UNSENT, httpx.UnsupportedProtocol))
        # One delivered attempt is sufficient: the supervisor may have accepted it and ended after
        # that.
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
    """Return whether the certificate of the supervisor is not trusted; no retry can change that."""
    while error is not None:
        if isinstance(error, ssl.SSLCertVerificationError):
            return True
        error = error.__cause__ or error.__context__
    return False


def identity_headers(
    operator: str | None, key: str | None, claim: str | None = None
) -> dict[str, str]:
    """Return headers that identify the caller; raises ValueError if a value is not allowed in a
    header.
    """
    headers: dict[str, str] = {}
    if operator is not None:
        if not operator.isprintable() or not operator.strip() or len(operator) > OPERATOR_MAX:
            raise ValueError(
                f"operator = {operator!r}: 1 to {OPERATOR_MAX} printable characters are required"
            )
        # A header can contain only ASCII; characters with a special meaning are also encoded.
        headers["X-Operator"] = quote(operator, safe=" ,;:!?()[]/@+*'&$=-_.~")
    if key is not None:
        if not _is_printable(key, KEY_MAX) or " " in key:
            # The message does not contain the key, which is a secret.
            raise ValueError(
                f"the key is not valid: 1 to {KEY_MAX} characters without blanks are required"
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


def traced(traceparent: str | None) -> dict[str, str]:
    """Return the header for a W3C trace context; empty without one."""
    return {} if traceparent is None else {"traceparent": traceparent}


def _is_printable(text: str, most: int) -> bool:
    return text.isascii() and text.isprintable() and 0 < len(text) <= most


def model(kind: type[M]) -> Callable[[httpx.Response], M]:
    """Return a function that parses a model from a reply and ignores unknown fields."""
    return lambda response: kind.model_validate_json(response.content, extra="ignore")


def get(path: str, kind: type[M], **query: str | float | None) -> Call[M]:
    """Return a call that only reads; query parameters that are None are omitted."""
    given = {name: value for name, value in query.items() if value is not None}
    return Call("GET", path, model(kind), given, repeatable=True)


def post(path: str, kind: type[M], body: Any = None, *, repeatable: bool = False) -> Call[M]:
    """Return a call that changes something."""
    return Call("POST", path, model(kind), body=body, repeatable=repeatable)


def require_supervisor(response: httpx.Response) -> None:
    """Raise GatewayError if a proxy has replied instead of the supervisor."""
    kind = response.headers.get("content-type", "").partition(";")[0]
    if response.status_code in GATEWAY and kind not in (MEDIA_TYPE, "application/json"):
        raise GatewayError(
            f"status {response.status_code}, without a problem document; is it a supervisor?"
        )


def require_finite(tree: Any, path: tuple[str, ...] = ()) -> None:
    """Raise InvalidRequestError for a number that JSON cannot represent: NaN or infinity."""
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
    """Return the body of a reply that is a file."""
    return response.content


def _unreadable(error: ValueError) -> str:
    """Return, as text, why a reply cannot be parsed."""
    if not isinstance(error, ValidationError):
        return str(error).partition("\n")[0]
    found = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in found["loc"]) or "the answer"
    return f"{place} {refusal(found)}"
