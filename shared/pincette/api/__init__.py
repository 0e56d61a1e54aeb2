"""What goes over REST: requests, plans, results, problems, and the life of a job as data."""

from typing import Any

from pydantic import BaseModel, BeforeValidator, ConfigDict

CONFIG = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class Model(BaseModel):
    """Refuses unknown fields, numbers that are not finite, and values of another type."""

    model_config = CONFIG


def example(**values: Any) -> ConfigDict:
    """An example for the OpenAPI document."""
    return ConfigDict(json_schema_extra={"examples": [values]})


def _whole(value: object) -> object:
    return int(value) if isinstance(value, float) and value.is_integer() else value


WHOLE = BeforeValidator(_whole)
"""Of an integer as JSON has them: 5.0 is 5, and 5.5 is refused; stands after its limits."""
