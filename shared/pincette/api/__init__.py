"""Data types of the REST interface: requests, plans, results, problems and states of a job."""

from typing import Any

from pydantic import BaseModel, BeforeValidator, ConfigDict

import pincette

BASE = "/api/v1"
"""Beginning of the path of every route, with the version of the REST interface."""
CONFIG = ConfigDict(
    extra="forbid",
    strict=True,
    allow_inf_nan=False,
    frozen=True,
    use_attribute_docstrings=True,  # they are descriptions in the OpenAPI document
    defer_build=pincette.is_command,
)


class Model(BaseModel):
    """Base of all models; it refuses unknown fields, wrong types, NaN and infinity."""

    model_config = CONFIG


def example(**values: Any) -> ConfigDict:
    """Return an example for the OpenAPI document."""
    return ConfigDict(json_schema_extra={"examples": [values]})


def _whole(value: object) -> object:
    return int(value) if isinstance(value, float) and value.is_integer() else value


WHOLE = BeforeValidator(_whole)
"""Validator of integers in JSON: accepts 5.0 as 5 and rejects 5.5. In an annotation it must come
after the limits.
"""
