"""A route that takes no request it does not understand to the last word.

FastAPI passes over a query parameter that no route knows, and of one that comes twice takes the
last. So ``?dryrun=true`` would move the arm. An emergency stop alone passes over everything: a
wrong word is no reason not to stop. Who may not ask is told that first, and nothing of the rest.
"""

import json
from collections import Counter
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

from fastapi import Request, Response, params
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute

from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import authorize
from pincette_supervisor.rest.limits import ESTOP
from pincette_supervisor.rest.query_numbers import numeric_names, require_numbers

JSON = "application/json"
Handler = Callable[[Request], Coroutine[Any, Any, Response]]


class RepeatedKeyError(ValueError):
    """An object of a body names a member twice."""


class StrictRoute(APIRoute):
    """Refuses unknown and repeated query parameters, bodies of another type, and broken JSON."""

    def get_route_handler(self) -> Handler:
        """The handler of the route, behind the checks."""
        handler = super().get_route_handler()
        if self.path.endswith(ESTOP):
            return handler
        known, has_body = sorted(set(query_names(self.dependant))), self.body_field is not None
        numeric = dict(numeric_names(self.dependant))
        secured = [one for one in self.dependencies if isinstance(one, params.Security)]
        needed = [scope for one in secured for scope in one.scopes or ()]

        async def strict(request: Request) -> Response:
            authorize(request, needed)
            require_known(request, known)
            require_numbers(request, numeric)
            if has_body:
                require_json(request.headers.get("content-type", ""), await request.body())
            return await handler(request)

        return strict


def query_names(dependant: Dependant) -> Iterator[str]:
    """Names of the query parameters of a route and of all that it depends on."""
    for field in dependant.query_params:
        yield field.alias
    for inner in dependant.dependencies:
        yield from query_names(inner)


def require_known(request: Request, known: list[str]) -> None:
    """Raise RequestValidationError for each query parameter that is unknown or repeated."""
    errors: list[dict[str, Any]] = []
    for name, count in Counter(name for name, _ in request.query_params.multi_items()).items():
        value = request.query_params[name]
        told: dict[str, Any] = {"loc": ("query", name), "input": value, "msg": "", "ctx": {}}
        if name not in known:
            told |= {"type": "extra_forbidden", "ctx": {"known": known}}
        elif count > 1:
            told |= {"type": "repeated", "ctx": {"count": count}}
        else:
            continue
        errors.append(told)
    if errors:
        raise RequestValidationError(errors)


def require_json(kind: str, body: bytes) -> None:
    """Raise ProblemError: 415 for a body of another type, 400 for one that is not JSON."""
    if not body:
        return
    essence = kind.partition(";")[0].strip().lower()
    if essence != JSON and not (essence.startswith("application/") and essence.endswith("+json")):
        said = f"Content-Type = {kind[:100]!r}" if kind else "Content-Type is missing"
        raise ProblemError(
            415,
            "unsupported-media-type",
            "The body is not declared as JSON",
            f"{said}: send Content-Type: {JSON}",
        )
    try:
        json.loads(body, object_pairs_hook=_object)
    except RecursionError as error:
        raise _broken("it is nested too deeply") from error
    except json.JSONDecodeError as error:
        raise _broken(f"{error.msg} at line {error.lineno}, column {error.colno}") from error
    except UnicodeDecodeError as error:
        raise _broken(f"byte {error.start} is not UTF-8") from error
    except ValueError as error:  # a repeated key, or an integer of thousands of digits
        raise _broken(str(error)[:200]) from error


def _broken(why: str) -> ProblemError:
    detail = f"{why}: mend the body and send it again"
    return ProblemError(400, "bad-json", "The body is not JSON that can be used", detail)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        ((name, count),) = Counter(name for name, _ in pairs).most_common(1)
        shown = ascii(name) if len(name) <= 60 else ascii(name[:57]) + "..."
        raise RepeatedKeyError(f"the member {shown} comes {count} times in one object")
    return found
