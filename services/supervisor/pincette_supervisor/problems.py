"""Errors as problem details (RFC 9457): what, value, unit, limit, and what to do."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from http import HTTPStatus
from typing import Any, cast, get_args

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from pincette.api.calibration_models import CalibrationName
from pincette.api.job_models import JobKind
from pincette.api.problem_models import MEDIA_TYPE, TYPE
from pincette_supervisor.journal.base import StoreError
from pincette_supervisor.planning.calibration_support import UnsupportedError

UNITS = {
    "_mN_per_um": "mN/µm",
    "_um_per_s": "µm/s",
    "_V_per_s": "V/s",
    "_mN": "mN",
    "_um": "µm",
    "_V": "V",
    "_s": "s",
    "_hz": "Hz",
}
KINDS = (*get_args(JobKind), *get_args(CalibrationName))
CODES = {
    404: "not-found",
    405: "method-not-allowed",
    408: "body-too-slow",
    413: "body-too-large",
    422: "invalid-request",
}

MOST_FAULTS = 20
"""Of a request, that are told; a person mends one after the other."""
SERVED = "/api/v1"
OTHER_VERSION = re.compile(rf"/api/(?!{SERVED.rpartition('/')[2]}(?:/|$))")


class ProblemError(Exception):
    """A request that is refused; becomes a problem document."""

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


def _document(
    status: int,
    code: str,
    title: str,
    detail: str,
    extensions: Mapping[str, object] | None = None,
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    extensions = extensions or {}
    body = {"type": TYPE + code, "title": title, "status": status, "detail": detail, **extensions}
    return JSONResponse(
        body, status_code=status, media_type=MEDIA_TYPE, headers=dict(headers or {})
    )


def answer(error: ProblemError) -> JSONResponse:
    """The document of a problem."""
    return _document(
        error.status, error.code, error.title, error.detail, error.extensions, error.headers
    )


def unit_of(name: str) -> str:
    """Unit that a field name carries as its suffix."""
    return next((unit for suffix, unit in UNITS.items() if name.endswith(suffix)), "")


def _shown(value: Any) -> str:
    text = repr(value) if not isinstance(value, dict | list) else type(cast(Any, value)).__name__
    return text if len(text) <= 60 else text[:57] + "..."


def _named(path: Sequence[str]) -> str:
    """The last member of a path, with its places in a list."""
    names = [place for place, part in enumerate(path) if not part.isdigit()]
    last = names[-1] if names else 0
    return "".join([*path[last : last + 1], *(f"[{index}]" for index in path[last + 1 :])])


def fault(error: Mapping[str, Any]) -> dict[str, str]:
    """One entry of ``errors``: where in the request, and what is wrong with the value there."""
    place, *path = (str(part) for part in error["loc"])
    while path and path[0] in KINDS:
        # Not a member: which kind of request the others were checked as.
        path = path[1:]
    name = _named(path) or place
    unit = unit_of(name.partition("[")[0])
    value = _shown(error.get("input")) + (f" {unit}" if unit else "")
    message = str(error["msg"])
    kind = str(error["type"])
    context = error.get("ctx", {})
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        path = [str(context["discriminator"]).strip("'")]
        name = path[0]
    if kind == "extra_forbidden":
        message = f"{name} is not a field that is known here"
    elif kind == "union_tag_invalid":
        expected = context["expected_tags"]
        message = f"{name} = {context['tag']!r}: not one of {expected}"
    elif kind in ("missing", "union_tag_not_found"):
        message = f"{name} is missing"
    elif kind == "json_invalid":
        name, message = "body", f"not JSON: {context.get('error', message)}"
    elif kind == "value_error":
        message = message.removeprefix("Value error, ")
    else:
        limit = f" {unit}" if unit and kind.startswith(("greater", "less")) else ""
        message = f"{name} = {value}: {message[:1].lower()}{message[1:]}{limit}"
    if place == "body" and kind != "json_invalid":
        return {"pointer": "".join(f"/{part}" for part in path), "message": message}
    if place == "body":
        return {"pointer": "", "message": message}
    return {"parameter": name, "message": message}


def invalid(errors: Sequence[Mapping[str, Any]]) -> JSONResponse:
    """422 with one entry for each fault of the request."""
    faults = [fault(error) for error in errors[:MOST_FAULTS]]
    detail = "; ".join(entry["message"] for entry in faults)
    if len(errors) > MOST_FAULTS:
        detail += f"; and {len(errors) - MOST_FAULTS} more"
    return _document(
        422, "invalid-request", "The request cannot be used", detail, {"errors": faults}
    )


def install(app: FastAPI) -> None:
    """Make every error of an application a problem document."""

    async def problem(_request: Request, error: Exception) -> JSONResponse:
        return answer(cast(ProblemError, error))

    async def validation(_request: Request, error: Exception) -> JSONResponse:
        return invalid(cast(RequestValidationError, error).errors())

    async def http(request: Request, error: Exception) -> JSONResponse:
        known = cast(HTTPException, error)
        phrase = HTTPStatus(known.status_code).phrase
        place = f"{request.method} {request.url.path}"
        detail = phrase if known.detail == phrase else str(known.detail)
        if known.status_code == 404 and OTHER_VERSION.match(request.url.path):
            detail = f"this supervisor serves {SERVED}, and no other version"
        code = CODES.get(known.status_code, phrase.lower().replace(" ", "-"))
        return _document(
            known.status_code, code, phrase, f"{place}: {detail}", headers=known.headers
        )

    async def unforeseen(request: Request, error: Exception) -> JSONResponse:
        detail = f"{request.method} {request.url.path}: {type(error).__name__}: {error}"
        return _document(500, "internal-error", "The supervisor has a fault", detail)

    async def unwritten(_request: Request, error: Exception) -> JSONResponse:
        title = "The journal cannot be used"
        return _document(503, "store-failed", title, str(error))

    app.add_exception_handler(ProblemError, problem)
    app.add_exception_handler(StoreError, unwritten)
    app.add_exception_handler(RequestValidationError, validation)
    app.add_exception_handler(HTTPException, http)
    app.add_exception_handler(Exception, unforeseen)


def not_found(what: str, name: str, known: Sequence[str] = ()) -> ProblemError:
    """404 that says what there is."""
    there = f"; there are {', '.join(known)}" if known else ""
    return ProblemError(404, "not-found", "Not found", f"no {what} {name!r}{there}")


def unsupported(error: UnsupportedError) -> ProblemError:
    """422 with the bandwidth that there is, and each instrument's part in it."""
    return ProblemError(
        422,
        "calibration-unsupported",
        "The instruments are too slow for this calibration",
        str(error),
        needed_hz=error.needed_hz,
        bandwidth_hz=error.bandwidth_hz,
        parts=[asdict(part) for part in error.parts],
    )
