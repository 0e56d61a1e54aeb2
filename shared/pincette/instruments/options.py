"""Options of a driver from the rig file; unknown options and impossible values are rejected."""

from collections.abc import Mapping
from typing import TypeVar

from pydantic import ValidationError

from pincette.config import ConfigError, Table
from pincette.core.validation_wording import refusal, value_text

T = TypeVar("T", bound=Table)


def read_options(model: type[T], driver: str, options: Mapping[str, object]) -> T:
    """Validate the options with a driver's model.

    Raises
    ------
    ConfigError
        With one line for each fault, and the existing options.
    """
    try:
        return model.model_validate(dict(options))
    except ValidationError as error:
        faults = [
            f"{driver} option {'.'.join(str(part) for part in fault['loc'])} = "
            f"{value_text(fault['input'])}: {refusal(fault)}"
            for fault in error.errors(include_url=False)
        ]
        known = ", ".join(model.model_fields)
        raise ConfigError("\n".join([*faults, f"{driver} has the options {known}"])) from error
