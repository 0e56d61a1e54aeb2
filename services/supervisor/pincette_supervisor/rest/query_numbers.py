"""Numbers in the query of a request, in the form that JSON has.

Pydantic reads a query parameter more liberally: ``1_0`` as 10, `` 5 `` as 5.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from fastapi import Request
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError

INTEGER = re.compile(r"-?[0-9]+")
NUMBER = re.compile(r"-?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?")


def numeric_names(dependant: Dependant) -> Iterator[tuple[str, type]]:
    """Yield each query parameter that is a number, with ``int`` or ``float``."""
    for field in dependant.query_params:
        annotation = field.field_info.annotation
        kinds = [one for one in (annotation, *get_args(annotation)) if one in (int, float)]
        if kinds:
            yield field.alias, float if float in kinds else int
    for inner in dependant.dependencies:
        yield from numeric_names(inner)


def require_numbers(request: Request, numeric: Mapping[str, type]) -> None:
    """Raise RequestValidationError for each number in the query that JSON would not have."""
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
