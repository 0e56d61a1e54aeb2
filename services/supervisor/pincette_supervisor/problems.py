"""Errors as problem details (RFC 9457), with value, unit, limit and remedy."""

import logging
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from difflib import get_close_matches
from functools import cache
from http import HTTPStatus
from typing import Any, cast
from uuid import uuid4

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.routing import BaseRoute, Match
from starlette.types import Scope

from pincette.api import BASE
from pincette.api.job_kinds import job_kinds
from pincette.api.problems import MEDIA_TYPE, TYPE, remedy_of
from pincette.bus.protocol import BusError
from pincette.core.units import unit_of
from pincette.core.validation_wording import refusal, value_text
from pincette_supervisor.journal.database import StoreError
from pincette_supervisor.plugin import UnsupportedError

log = logging.getLogger(__name__)
CODES = {
    404: "not-found",
    405: "method-not-allowed",
    408: "body-too-slow",
    413: "body-too-large",
    415: "unsupported-media-type",
    422: "invalid-request",
}

UNUSABLE = "The request cannot be used"
ERRORS_MAX = 20
"""Largest number of errors that are listed for a request."""
METHODS = ("GET", "POST", "PUT", "PATCH", "DELETE")
"""HTTP methods of the routes; HEAD and OPTIONS are derived from them."""
OTHER_VERSION = re.compile(rf"/api/(?!{BASE.rpartition('/')[2]}(?:/|$))")


class ProblemError(Exception):
    """A rejected request; the response is a problem document."""

    def __init__(
        self,
        status: int,
        code: str,
        title: str,
        detail: str,
        *,
        headers: Mapping[str, str] | None = None,
        **extensions: object,
    ) -> None:
        super().__init__(detail)
        self.status = status
        self.code = code
        self.title = title
        self.detail = detail
        self.headers = headers
        self.extensions = extensions


def response_of(error: ProblemError) -> JSONResponse:
    """Return the response to a rejected request."""
    instance = f"urn:uuid:{uuid4()}"
    log.info("refused: %s (%s), %s", error.detail, error.code, instance)
    body = {
        "type": TYPE + error.code,
        "title": error.title,
        "status": error.status,
        "detail": error.detail,
        "remedy": remedy_of(error.code),
        "instance": instance,
    }
    return JSONResponse(
        {**body, **error.extensions},
        status_code=error.status,
        media_type=MEDIA_TYPE,
        headers=dict(error.headers or {}),
    )


def _cut(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


def _shown(value: Any) -> str:
    if isinstance(value, dict | list):
        return "an object" if isinstance(value, dict) else "a list"
    return _cut(value_text(value))


def _named(path: Sequence[str]) -> str:
    """Return the last field of a path, with its list indices."""
    names = [place for place, part in enumerate(path) if not part.isdigit()]
    last = names[-1] if names else 0
    return "".join([*path[last : last + 1], *(f"[{index}]" for index in path[last + 1 :])])


@cache
def request_fields(tags: tuple[str, ...] = ()) -> frozenset[str]:
    """Return the names of all fields of requests for jobs, or those of one kind of job.

    ``tags`` are the kind and its variant, if known.
    """
    found = [kind for kind in job_kinds().values() if not tags or kind.name == tags[0]]
    requests = [
        kind.request_of(name)
        for kind in found or job_kinds().values()
        for name in (kind.variants or ("",))
        if name in tags[1:] or not {*kind.variants} & {*tags[1:]}
    ]
    return frozenset(name for request in requests for name in request.model_fields)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return a hint with the most similar of other names; empty if no name is similar."""
    plain = {one.replace("_", "").lower(): one for one in sorted({*known} - {name})}
    near = get_close_matches(name.replace("_", "").replace("-", "").lower(), plain, n=1)
    return f"; did you mean {plain[near[0]]}?" if near else ""


def error_entry(error: Mapping[str, Any]) -> dict[str, str]:
    """Return an entry of ``errors``: the place in the request, and what is wrong with its value."""
    place, *path = (str(part) for part in error["loc"])
    kinds = job_kinds()
    tags = {*kinds, *(name for kind in kinds.values() for name in kind.variants)}
    # The body was checked as a kind of request, and that kind is not a field; but an unknown field
    # may have the name of a kind, such as `hold`.
    kept, named = int(str(error["type"]) == "extra_forbidden"), list[str]()
    while len(path) > kept and path[0] in tags:
        named.append(path.pop(0))
    path = [_cut(part) for part in path]
    name = _named(path) or place
    unit = unit_of(name.partition("[")[0])
    value = _shown(error.get("input")) + (f" {unit}" if unit else "")
    wanted = refusal(error, unit)
    kind = str(error["type"])
    context = error.get("ctx", {})
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        path = [str(context["discriminator"]).strip("'")]
        name = path[0]
    if kind == "extra_forbidden":
        what = "field" if place == "body" else "parameter"
        known = request_fields(tuple(named)) if place == "body" else context.get("known", ())
        message = f"{name} is not a known {what}{did_you_mean(name, known)}"
    elif kind == "repeated":
        message = f"{name} is given {context['count']} times: send it once"
    elif kind == "union_tag_invalid":
        expected = context["expected_tags"]
        given = cast(Mapping[str, Any], error["input"])[name]
        message = f"{name} = {_shown(given)}: not one of {expected}"
    elif kind in ("missing", "union_tag_not_found"):
        message = f"{name} is missing"
    elif kind == "json_invalid":
        name, message = "body", f"not JSON: {context.get('error', '')}"
    elif kind == "value_error":
        message = wanted
    else:
        message = f"{name} = {value}: {wanted}"
    if place == "body" and kind != "json_invalid":
        return {"pointer": "".join(f"/{part}" for part in path), "message": message}
    if place == "body":
        return {"pointer": "", "message": message}
    return {"parameter": name, "message": message}


def invalid(errors: Sequence[Mapping[str, Any]]) -> JSONResponse:
    """Return a 422 problem with an entry for each error of the request."""
    entries = [error_entry(error) for error in errors[:ERRORS_MAX]]
    detail = "; ".join(entry["message"] for entry in entries)
    if len(errors) > ERRORS_MAX:
        detail += f"; and {len(errors) - ERRORS_MAX} more"
    return response_of(ProblemError(422, "invalid-request", UNUSABLE, detail, errors=entries))


def allowed_methods(routes: Sequence[BaseRoute], scope: Scope) -> list[str]:
    """Return the methods of a request's path; empty if no route has this path."""
    found = [
        method
        for method in METHODS
        if any(route.matches({**scope, "method": method})[0] is Match.FULL for route in routes)
    ]
    if not found:
        return []
    return [*found, *(["HEAD"] if "GET" in found else []), "OPTIONS"]


def install_handlers(app: FastAPI) -> None:
    """Install handlers that answer every error of an application with a problem document."""

    async def problem(_request: Request, error: Exception) -> JSONResponse:
        return response_of(cast(ProblemError, error))

    async def validation(_request: Request, error: Exception) -> JSONResponse:
        return invalid(cast(RequestValidationError, error).errors())

    async def http(request: Request, error: Exception) -> JSONResponse:
        known = cast(HTTPException, error)
        phrase = HTTPStatus(known.status_code).phrase
        path, headers = request.scope["path"], dict(known.headers or {})
        detail = phrase if known.detail == phrase else str(known.detail)
        if known.status_code == 404 and OTHER_VERSION.match(path):
            detail = f"this supervisor serves {BASE} only"
        elif known.status_code == 404 and f"{BASE}/" in path.removeprefix(BASE):
            prefix = path.partition(BASE)[0]
            detail = f"the path begins with {prefix!r}, which a reverse proxy must remove"
        elif known.status_code == 405:
            headers["Allow"] = ", ".join(allowed_methods(app.routes, request.scope))
            detail = f"this path allows {headers['Allow']}"
        code = CODES.get(known.status_code, phrase.lower().replace(" ", "-"))
        text = f"{request.method} {path}: {detail}"
        return response_of(ProblemError(known.status_code, code, phrase, text, headers=headers))

    async def internal(request: Request, error: Exception) -> JSONResponse:
        detail = f"{request.method} {request.scope['path']}: {type(error).__name__}: {error}"
        title = "The supervisor has a fault"
        return response_of(ProblemError(500, "internal-error", title, detail))

    async def store_failed(_request: Request, error: Exception) -> JSONResponse:
        title = "The journal cannot be used"
        return response_of(ProblemError(503, "store-failed", title, str(error)))

    app.add_exception_handler(ProblemError, problem)
    app.add_exception_handler(StoreError, store_failed)
    app.add_exception_handler(RequestValidationError, validation)
    app.add_exception_handler(HTTPException, http)
    app.add_exception_handler(Exception, internal)


def unusable(message: str, **place: str) -> ProblemError:
    """Return a 422 problem for one fault of a request.

    ``place`` is its pointer or its parameter.
    """
    known: dict[str, Any] = {"errors": [{**place, "message": message}]} if place else {}
    return ProblemError(422, "invalid-request", UNUSABLE, message, **known)


def not_found(what: str, name: str, known: Sequence[str] = (), *, why: str = "") -> ProblemError:
    """Return a 404 problem that lists the existing objects, or says why there are none."""
    there = f"; there are {', '.join(known)}" if known else f"; {why}" if why else ""
    return ProblemError(404, "not-found", "Not found", f"no {what} {name!r}{there}")


def unsupported(error: UnsupportedError) -> ProblemError:
    """Return a 422 problem with the available bandwidth, and each instrument's contribution."""
    return ProblemError(
        422,
        "calibration-unsupported",
        "The instruments are too slow for this calibration",
        str(error),
        needed_hz=error.needed_hz,
        bandwidth_hz=error.bandwidth_hz,
        parts=[asdict(part) for part in error.parts],
    )


def unanswered(error: BusError) -> ProblemError:
    """Return a 503 problem: a program of the rig does not reply."""
    return ProblemError(
        503, "rig-not-ready", "The rig does not answer", str(error), reasons=[str(error)]
    )
