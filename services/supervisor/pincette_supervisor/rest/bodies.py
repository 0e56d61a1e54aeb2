"""What the OpenAPI document says of bodies, where FastAPI says too little or what is wrong."""

from typing import Any

from pincette.api.problem_models import responses

SCHEMAS = "#/components/schemas/"


def complete_bodies(document: dict[str, Any]) -> None:
    """Say how a body that cannot be read is answered, and give unions within unions a name."""
    schemas = document["components"]["schemas"]
    for operations in document["paths"].values():
        for operation in operations.values():
            for content in operation.get("requestBody", {}).get("content", {}).values():
                operation["responses"].update(
                    {str(status): answer for status, answer in responses(400).items()}
                )
                _name_inner_unions(content["schema"], schemas)


def _name_inner_unions(schema: dict[str, Any], schemas: dict[str, Any]) -> None:
    """A discriminator may map to names of schemas only, so what it maps to becomes one."""
    mapping = schema.get("discriminator", {}).get("mapping", {})
    for value, choice in mapping.items():
        if isinstance(choice, dict):
            name = f"{value.title()}JobRequest"
            inner = {"$ref": SCHEMAS + name}
            place = schema["oneOf"].index(choice)
            first = schemas[schema["oneOf"][place]["oneOf"][0]["$ref"].removeprefix(SCHEMAS)]
            schemas[name] = {**choice, "examples": first["examples"]}
            schema["oneOf"][place] = inner
            mapping[value] = inner["$ref"]
