"""The committed OpenAPI document matches the supervisor's own description."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest
from pydantic import BaseModel, ValidationError

from pincette.api import Model
from pincette.api.jobs import ActionRequest
from pincette.api.places import MEASURED, PartPlace, SeenPlace
from pincette.api.requests import JobRequest
from pincette.api.series import SeriesRequest
from pincette_supervisor.kinds.calibrate.requests import (
    FreeResponseRequest,
    FrequencyResponseRequest,
)
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.motions import (
    CarryJobRequest,
    HoldJobRequest,
    MoveJobRequest,
    ReleaseJobRequest,
)
from pincette_supervisor.kinds.track import TrackJobRequest
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


def derived(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
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


GRIP = {"kind": "grip"}
MOVE, TARGETS = {"kind": "move", "to_um": 5.0}, ("to_um", "by_um", "to_V", "by_V")
FREE = {"kind": "calibrate", "calibration": "free_response"}
SWEEP = {"kind": "calibrate", "calibration": "frequency_response"}
PLACE_NEEDS = ("given_by", "bus")
CYCLES = ("conditioning_cycles", "warm_up_s")
RULES: list[tuple[type[BaseModel], dict[str, Any], tuple[str, ...]]] = [
    (ActionRequest, {"type": "retry_at"}, ("place", "retry_at")),
    (ActionRequest, {"type": "stop", "place": MEASURED}, ("place", "retry_at")),
    *(
        (PartPlace, {k: v for k, v in MEASURED.items() if k != name}, (name, *PLACE_NEEDS))
        for name in MEASURED
    ),
    *(
        (PartPlace, {"given_by": "bus", name: MEASURED[name]}, (name, *PLACE_NEEDS))
        for name in ("x_um", "u_um", "measured_at")
    ),
    (PartPlace, {**MEASURED, "width_um": 9.0}, ("width_um", "u_width_um")),
    (PartPlace, {"given_by": "bus", "width_um": 9.0}, ("width_um", *PLACE_NEEDS)),
    (SeenPlace, {**MEASURED, "age_s": 0.4, "u_width_um": 0.2}, ("width_um", "u_width_um")),
    (SeriesRequest, {"values": [{}], "csv": "sample"}, ("values", "grid", "csv")),
    (GripJobRequest, GRIP | {"load_s": 1.0, "load_um_per_s": 5.0}, ("load_s", "load_um_per_s")),
    (GripJobRequest, GRIP | {"hold_s": 1.0, "until_released": True}, ("hold_s", "until_released")),
    (
        GripJobRequest,
        GRIP | {"settling_s": 1.0},
        ("settling_s", "position_tolerance_um", "force_tolerance_mN"),
    ),
    (MoveJobRequest, {"kind": "move"}, TARGETS),
    (MoveJobRequest, MOVE | {"to_V": 1.0}, TARGETS),
    (MoveJobRequest, MOVE | {"force_tolerance_mN": 1.0}, ("force_tolerance_mN",)),
    (
        MoveJobRequest,
        {"kind": "move", "to_V": 1.0, "position_tolerance_um": 1.0},
        ("position_tolerance_um", "to_um", "by_um"),
    ),
    (
        MoveJobRequest,
        MOVE | {"conditioning_cycles": 1, "low_V": 1.0, "high_V": 1.0},
        ("low_V", "high_V"),
    ),
    *(
        (MoveJobRequest, MOVE | {name: 1.0}, (name, *CYCLES))
        for name in ("low_V", "high_V", "rate_V_per_s")
    ),
    (HoldJobRequest, {"kind": "hold", "load_s": 1.0}, ("load_s", "force_mN")),
    (
        HoldJobRequest,
        {"kind": "hold", "hold_s": 1.0, "until_released": True},
        ("hold_s", "until_released"),
    ),
    *(
        (ReleaseJobRequest, {"kind": "release", name: 1.0}, (name, name.partition("_")[0]))
        for name in ("dither_um", "dither_hz", "dither_s", "wait_s")
    ),
    *(
        (ReleaseJobRequest, {"kind": "release", "strategies": [name, name]}, ("strategies", name))
        for name in ("dither", "wait")
    ),
    (CarryJobRequest, {"kind": "carry"}, ("by_um", "to_um")),
    (CarryJobRequest, {"kind": "carry", "by_um": 1.0, "to_um": 1.0}, ("by_um", "to_um")),
    (FreeResponseRequest, FREE | {"low_V": 1.0, "high_V": 1.0}, ("low_V", "high_V")),
    (FrequencyResponseRequest, SWEEP | {"from_hz": 9.0, "to_hz": 9.0}, ("from_hz", "to_hz")),
    (
        TrackJobRequest,
        {"kind": "track", "force_mN": 8.0, "force": {}},
        ("force_mN", "force"),
    ),
    (
        TrackJobRequest,
        {
            "kind": "track",
            "points": [{"t_s": 0.0, "force_mN": 1.0}, {"t_s": 1.0, "force_mN": 2.0}],
            "x_points": [{"t_s": 0.0, "x_um": 1.0}, {"t_s": 1.0, "x_um": 2.0}],
        },
        ("points", "x_points"),
    ),
    (
        TrackJobRequest,
        {"kind": "track", "force_pp_mN": 8.0, "x_pp_um": 2.0},
        ("force_pp_mN", "x_pp_um"),
    ),
]
"""Rules between members: a model, a request that breaks the rule, and the names in the rule."""


def test_a_description_states_each_rule_between_members() -> None:
    schemas = json.loads(openapi_document())["components"]["schemas"]
    for model, request, names in RULES:
        with pytest.raises(ValidationError) as refused:
            model.model_validate(request)
        assert {error["type"] for error in refused.value.errors()} == {"value_error"}, request
        schema = schemas[model.__name__]
        texts = {name: one.get("description", "") for name, one in schema["properties"].items()}
        texts[""] = schema["description"]
        assert any(
            all(name == member or f"``{name}``" in text for name in names)
            for member, text in texts.items()
        ), (model.__name__, names)


def test_a_model_with_a_rule_between_members_is_in_the_table() -> None:
    schemas = json.loads(openapi_document())["components"]["schemas"]
    ruled = {
        part.__name__
        for model in (*derived(Model), *derived(JobRequest))
        if model.__name__ in schemas
        for part in model.__mro__
        if has_own_rule(part)
    }
    assert ruled >= {"PartPlace", "ActionRequest", "MoveJobRequest"}
    assert ruled <= {part.__name__ for model, _, _ in RULES for part in model.__mro__}


def has_own_rule(model: type) -> bool:
    """Return whether a class defines a validator of all its members."""
    decorators: Any = getattr(model, "__pydantic_decorators__", None)
    return decorators is not None and not vars(model).keys().isdisjoint(decorators.model_validators)
