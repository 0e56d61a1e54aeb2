"""A route that rejects each request that it does not understand completely.

FastAPI ignores unknown query parameters, and uses the last one of repeated parameters. So
``?dryrun=true`` would move the arm. Only an emergency stop ignores everything: a wrong parameter is
no reason not to stop. A caller without the needed scope is rejected before anything else is read.

The thread that serves the emergency stop does no work whose cost grows with a body: a few worker
threads parse and validate the bodies, and bodies with more parts than any valid request has are
rejected unparsed.
"""

import asyncio
import json
import re
from collections import Counter
from collections.abc import Callable, Collection, Coroutine, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, get_args

from fastapi import Request, Response, params
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute

from pincette_supervisor import problems
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import authorize
from pincette_supervisor.rest.limits import ESTOP, MOST_BYTES, SMALL_BYTES, read_body

# Numbers in the query of a request, in the form that JSON has. Pydantic reads a query parameter
# less strictly: ``1_0`` as 10, `` 5 `` as 5.

INTEGER = re.compile(r"-?[0-9]+")
NUMBER = re.compile(r"-?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?")


def numeric_names(dependant: Dependant) -> Iterator[tuple[str, type]]:
    """Yield each numeric query parameter, with ``int`` or ``float``."""
    for field in dependant.query_params:
        annotation = field.field_info.annotation
        kinds = [one for one in (annotation, *get_args(annotation)) if one in (int, float)]
        if kinds:
            yield field.alias, float if float in kinds else int
    for inner in dependant.dependencies:
        yield from numeric_names(inner)


def require_numbers(request: Request, numeric: Mapping[str, type]) -> None:
    """Raise RequestValidationError for each number in the query that is not valid in JSON."""
    errors: list[dict[str, Any]] = []
    for name, kind in numeric.items():
        text = request.query_params.get(name)
        form = INTEGER if kind is int else NUMBER
        if text is not None and not form.fullmatch(text):
            code = f"{kind.__name__}_parsing"
            errors.append(
                {"loc": ("query", name), "input": text, "msg": "", "ctx": {}, "type": code}
            )
    if errors:
        raise RequestValidationError(errors)


JSON = "application/json"
SIGNS, SIGNS_MAX = b",:[{", 24_000
"""Characters that separate the parts of a body, and their largest number: a path of 4000 points
has 20 000 of them, and so have two paths of 2000 points each."""
MEMBERS_MAX = 200
"""Largest number of members of one object of a body, which bounds the number of its errors."""
PARAMETERS_MAX = 50
"""Largest number of query parameters of one request."""
TINY_BYTES = 512
"""Largest size of a body, in bytes, that is parsed at once without a thread, for example that of
a stop."""
PARSERS = ThreadPoolExecutor(2, thread_name_prefix="parse")
"""Threads that parse and validate all other bodies."""
Handler = Callable[[Request], Coroutine[Any, Any, Response]]


class RepeatedKeyError(ValueError):
    """Error raised if an object of a body contains a member twice."""


class CheckedRequest(Request):
    """A request whose body has been read and validated.

    Its JSON is the validated instance, which FastAPI accepts at once.
    """

    def __init__(self, request: Request, body: bytes, value: Any) -> None:
        super().__init__(request.scope, request.receive)
        self._read, self._value = body, value

    async def body(self) -> bytes:
        """Return the body."""
        return self._read

    async def json(self) -> Any:
        """Return the value of the body."""
        return self._value


class StrictRoute(APIRoute):
    """Rejects unknown and repeated query parameters, bodies of another type, and invalid JSON."""

    def get_route_handler(self) -> Handler:
        """Return the handler of the route, preceded by the checks."""
        handler = super().get_route_handler()
        if self.path.endswith(ESTOP):
            return handler
        known = sorted(set(query_names(self.dependant)))
        numeric = dict(numeric_names(self.dependant))
        secured = [one for one in self.dependencies if isinstance(one, params.Security)]
        needed = [scope for one in secured for scope in one.scopes or ()]
        field = self.body_field
        most_bytes = int((self.openapi_extra or {}).get(MOST_BYTES, SMALL_BYTES))

        def validated(body: bytes) -> Any:
            """Return the value of a body, or the response that rejects it."""
            assert field is not None
            value, errors = field.validate(parsed(body), loc=("body",))
            return problems.invalid(errors) if errors else value

        async def strict(request: Request) -> Response:
            try:
                authorize(request, needed)
            except ProblemError as refusal:
                if refusal.status == 403:
                    authorize(request, await self.needed_by(request))
                raise
            require_known(request, known)
            require_numbers(request, numeric)
            if field is not None:
                if has_body(request):
                    require_json(request)
                body = await read_body(request, most_bytes)
                if not body:
                    return await handler(CheckedRequest(request, body, None))
                require_json(request)
                if len(body) <= TINY_BYTES:
                    value = validated(body)
                else:
                    loop = asyncio.get_running_loop()
                    value = await loop.run_in_executor(PARSERS, validated, body)
                if isinstance(value, Response):
                    return value
                return await handler(CheckedRequest(request, body, value))
            return await handler(request)

        return strict

    async def needed_by(self, _: Request, /) -> Collection[str]:
        """Return the scopes that a refused request of a known caller needs beyond its route's."""
        return ()


def query_names(dependant: Dependant) -> Iterator[str]:
    """Yield the query parameters of a route and of its dependencies."""
    for field in dependant.query_params:
        yield field.alias
    for inner in dependant.dependencies:
        yield from query_names(inner)


def require_known(request: Request, known: list[str]) -> None:
    """Raise RequestValidationError for each unknown or repeated query parameter."""
    count = request.scope["query_string"].count(b"&") + 1
    if count > PARAMETERS_MAX:
        raise problems.unusable(f"{count} query parameters: the limit is {PARAMETERS_MAX}")
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


def has_body(request: Request) -> bool:
    """Return whether the head of a request announces a body."""
    headers = request.headers
    return "transfer-encoding" in headers or headers.get("content-length", "0") != "0"


def require_json(request: Request) -> None:
    """Raise ProblemError (415) for a body that is not declared as plain JSON."""
    kind = request.headers.get("content-type", "")
    essence = kind.partition(";")[0].strip().lower()
    if essence != JSON and not (essence.startswith("application/") and essence.endswith("+json")):
        problem = f"Content-Type = {kind[:100]!r}" if kind else "Content-Type is missing"
        raise _unsupported(f"{problem}: send Content-Type: {JSON}")
    coding = request.headers.get("content-encoding", "identity")
    if coding.strip().lower() != "identity":
        raise _unsupported(f"Content-Encoding = {coding[:100]!r}: send the body without one")


def _unsupported(why: str) -> ProblemError:
    return ProblemError(415, "unsupported-media-type", "The body is not declared as JSON", why)


def parsed(body: bytes) -> Any:
    """Parse a body; raises ProblemError: 400 for invalid JSON, 413 for too many parts."""
    signs = sum(body.count(sign) for sign in SIGNS)
    if signs > SIGNS_MAX:
        raise ProblemError(
            413,
            "body-too-large",
            "The body is too large",
            f"the body has {signs} commas, colons and brackets; the limit is {SIGNS_MAX}: "
            "use fewer points in a path",
            limit_signs=SIGNS_MAX,
        )
    try:
        return json.loads(body, object_pairs_hook=_object)
    except RecursionError as error:
        raise _broken("it is nested too deeply") from error
    except json.JSONDecodeError as error:
        raise _broken(f"{error.msg} at line {error.lineno}, column {error.colno}") from error
    except UnicodeDecodeError as error:
        raise _broken(f"byte {error.start} is not UTF-8") from error
    except ValueError as error:  # a repeated key, or an integer with thousands of digits
        raise _broken(str(error)[:200]) from error


def _broken(why: str) -> ProblemError:
    detail = f"{why}: correct the body and send it again"
    return ProblemError(400, "bad-json", "The body is not JSON that can be used", detail)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len(pairs) > MEMBERS_MAX:
        raise ProblemError(
            413,
            "body-too-large",
            "The body is too large",
            f"an object of the body has {len(pairs)} members; the limit is {MEMBERS_MAX}",
            limit_members=MEMBERS_MAX,
        )
    found = dict(pairs)
    if len(found) < len(pairs):
        ((name, count),) = Counter(name for name, _ in pairs).most_common(1)
        shown = ascii(name) if len(name) <= 60 else ascii(name[:57]) + "..."
        raise RepeatedKeyError(f"the member {shown} is given {count} times in one object")
    return found
