"""What goes over REST: requests, plans, results, problems, and the life of a job as data."""

from typing import Any

from pydantic import BaseModel, ConfigDict

CONFIG = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class Model(BaseModel):
    """Refuses unknown fields, numbers that are not finite, and values of another type."""

    model_config = CONFIG


def example(**values: Any) -> ConfigDict:
    """An example for the OpenAPI document."""
    return ConfigDict(json_schema_extra={"examples": [values]})
