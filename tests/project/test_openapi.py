"""The committed OpenAPI document matches the supervisor's own description."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

from pincette.api import Model
from pincette_supervisor.rest.api import OPERATIONS, openapi_document

COMMITTED = Path(__file__).parents[2] / "deploy" / "openapi.json"


def test_the_committed_document_equals_the_generated_one() -> None:
    assert COMMITTED.read_text(encoding="utf-8") == openapi_document(), (
        "deploy/openapi.json differs from the REST interface; if the change is wanted: make docs"
    )


def test_every_model_has_an_example() -> None:
    schemas: dict[str, Any] = json.loads(openapi_document())["components"]["schemas"]
    without = [
        name
        for name, schema in schemas.items()
        if "enum" not in schema and "examples" not in schema
    ]
    assert not without


def test_the_examples_are_accepted_by_their_models() -> None:
    """FastAPI leaves out a null inside an example, which then lacks a required member."""
    schemas = json.loads(openapi_document())["components"]["schemas"]
    models = {model.__name__: model for model in derived(Model)}
    checked = [name for name in schemas.keys() & models.keys() if "examples" in schemas[name]]
    assert len(checked) > 100
    for name in checked:
        for made in schemas[name]["examples"]:
            models[name].model_validate_json(json.dumps(made))


def derived(model: type[Model]) -> Iterator[type[Model]]:
    """Yield all models derived from one."""
    for child in model.__subclasses__():
        yield child
        yield from derived(child)


def test_every_operation_has_a_name_in_plain_words() -> None:
    paths = json.loads(openapi_document())["paths"].values()
    names = [one["operationId"] for operations in paths for one in operations.values()]
    assert sorted(names) == sorted(set(OPERATIONS.values()))
    assert {"start_job", "get_job", "act_on_job", "estop_rig"} <= set(names)


def test_a_request_member_is_not_also_a_parameter() -> None:
    document = json.loads(openapi_document())
    for operations in document["paths"].values():
        for operation in operations.values():
            text = json.dumps(operation.get("requestBody", {}))
            names = {part.split('"')[0] for part in text.split("#/components/schemas/")[1:]}
            schemas = [document["components"]["schemas"][name] for name in names]
            members = {name for schema in schemas for name in schema.get("properties", {})}
            requested = {one["name"] for one in operation.get("parameters", ())}
            assert members.isdisjoint(requested), operation["operationId"]


def test_an_operation_has_one_content_type_with_a_schema() -> None:
    for path, operations in json.loads(openapi_document())["paths"].items():
        for method, operation in operations.items():
            for status, answer in operation["responses"].items():
                content = answer.get("content", {})
                assert len(content) <= 1, (method, path, status)
                for media_type, body in content.items():
                    assert body.keys() & {"schema", "x-itemSchema"}, (method, path, status)
                    binary = media_type in ("application/octet-stream", "image/png")
                    assert (body.get("schema", {}).get("format") == "binary") == binary, path


def test_unions_are_not_nested() -> None:
    document = json.loads(openapi_document())
    schemas = document["components"]["schemas"]
    found = list(unions(document))
    assert len(found) > 3
    for choice in [choice for union in found for choice in union]:
        name = choice.get("$ref", "").removeprefix("#/components/schemas/")
        assert "oneOf" not in schemas.get(name, choice), choice


def unions(tree: Any) -> Iterator[Any]:
    """Yield the choices of each union of a document."""
    if isinstance(tree, dict):
        members = cast("dict[str, Any]", tree)
        if "oneOf" in members:
            yield members["oneOf"]
        tree = list(members.values())
    if isinstance(tree, list):
        for one in cast("list[Any]", tree):
            yield from unions(one)


def test_every_reference_is_resolved() -> None:
    text = openapi_document()
    schemas = json.loads(text)["components"]["schemas"]
    wanted = {part.split('"')[0] for part in text.split("#/components/schemas/")[1:]}
    assert wanted <= schemas.keys()
