"""The documented examples of the REST models, as they are sent over the wire."""

from typing import Any, cast

from pincette.api import Model


def example_of(model: type[Model], **changes: Any) -> Any:
    """Return the documented example of a model, with changes, as it is sent over REST."""
    extra = model.model_config.get("json_schema_extra")
    assert isinstance(extra, dict)
    examples = cast("list[dict[str, Any]]", extra["examples"])
    made = model.model_validate({**examples[0], **changes}, strict=False)
    assert model.model_validate_json(made.model_dump_json()) == made
    return made
