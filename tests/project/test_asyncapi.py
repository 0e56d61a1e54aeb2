"""The committed AsyncAPI document matches the topics and is complete and valid."""

import asyncio
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import httpx
import jsonschema_rs
import pytest
from msgspec import inspect
from msgspec.structs import fields

from pincette.asyncapi.document import document, tree
from pincette.asyncapi.schemas import type_schema
from pincette.config.programs import Bus
from pincette.core.codec import encode
from pincette.core.codec.refusals import msgpack
from pincette.core.faults import ActionCode, Cause, Mode
from pincette.core.messages import Action, Applied, Load, Position
from pincette.core.messages.arms import ArmApplied, ArmPosition
from pincette.core.topics import INPUTS, REQUESTS, ROOT, TOPICS, key, request_key
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.rest.api import create_app
from tests.support.rigs import demo_rig

COMMITTED = Path(__file__).parents[2] / "deploy" / "asyncapi.json"
NAME = re.compile(r"[A-Za-z0-9._-]+")
Json = dict[str, Any]
ABOUT = {"summary", "description"}
FIELDS = {
    "channels": {"address", "messages", "parameters", *ABOUT},
    "operations": {"action", "channel", "messages", "reply", *ABOUT},
    "servers": {"host", "protocol", "variables", *ABOUT},
}
COMPONENT_FIELDS = {
    "messages": {"name", "contentType", "payload", *ABOUT},
    "parameters": {"description", "examples"},
}
"""Fields of AsyncAPI 3.0.0 that the document uses; its schema refuses any other."""


def references(node: Any) -> Iterator[str]:
    if isinstance(node, dict):
        inner = cast(Json, node)
        if "$ref" in inner:
            yield inner["$ref"]
        for value in inner.values():
            yield from references(value)
    elif isinstance(node, list):
        for value in cast("list[Any]", node):
            yield from references(value)


def found(whole: Json, reference: str) -> Any:
    """Return the target of a reference; raises KeyError if there is none."""
    node: Any = whole
    for part in reference.removeprefix("#/").split("/"):
        node = node[part]
    return node


def test_the_committed_document_describes_the_topics() -> None:
    assert COMMITTED.read_text(encoding="utf-8") == document(), (
        "deploy/asyncapi.json differs from the topics and messages; if the change is wanted: "
        "`make docs`, and look at the difference. A listener that reads by field names survives "
        "a field that is added; for any other change, raise pincette.core.topics.WIRE"
    )


def test_the_document_is_served() -> None:
    async def read() -> httpx.Response:
        transport = httpx.ASGITransport(create_app(cast(Rigs, None)))
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.get("/asyncapi.json")

    answer = asyncio.run(read())
    assert answer.headers["content-type"] == "application/json"
    assert answer.text == document()


def test_every_reference_is_resolved() -> None:
    whole = tree()
    wanted = set(references(whole))
    assert wanted
    for reference in wanted:
        assert isinstance(found(whole, reference), dict), reference


def test_every_description_is_referenced() -> None:
    whole = tree()
    wanted = set(references(whole))
    for room, things in whole["components"].items():
        assert {name for name in things if f"#/components/{room}/{name}" not in wanted} == set()


def test_the_document_contains_only_fields_defined_by_asyncapi() -> None:
    whole = tree()
    for part, known in ((whole, FIELDS), (whole["components"], COMPONENT_FIELDS)):
        for room, names in known.items():
            for name, thing in part[room].items():
                assert thing.keys() <= names, f"{room}/{name}"
    assert whole.keys() - FIELDS.keys() == {
        "asyncapi",
        "info",
        "defaultContentType",
        "components",
    }


def test_channels_list_their_parameters_and_all_names_are_valid() -> None:
    whole = tree()
    for name, channel in whole["channels"].items():
        assert NAME.fullmatch(name)
        in_address = set(re.findall(r"\{(\w+)\}", channel["address"]))
        assert in_address == channel["parameters"].keys()
    for room in ("messages", "schemas", "parameters"):
        assert all(NAME.fullmatch(name) for name in whole["components"][room])
    addresses = [channel["address"] for channel in whole["channels"].values()]
    assert len(set(addresses)) == len(addresses)


def test_operations_carry_messages_of_their_own_channel() -> None:
    whole = tree()
    for name, operation in whole["operations"].items():
        assert NAME.fullmatch(name)
        assert operation["action"] in ("send", "receive")
        given = name in {f"receive_{topic.name}" for topic in INPUTS}
        assert ("reply" in operation) == (operation["action"] == "receive" and not given)
        for part in (operation, operation.get("reply", operation)):
            place = part["channel"]["$ref"]
            assert found(whole, place)["messages"]
            assert part["messages"]
            assert all(item["$ref"].startswith(f"{place}/messages/") for item in part["messages"])


def test_every_topic_and_request_is_described() -> None:
    whole = tree()
    operations = whole["operations"]
    for topic in TOPICS:
        assert whole["channels"][topic.name]["address"] == key("{rig}", topic, "{service}")
        assert {f"send_{topic.name}", f"latest_{topic.name}"} <= operations.keys()
        schema = whole["components"]["schemas"][topic.message.__name__]
        assert schema["required"] == [field.name for field in fields(topic.message)]
    for topic in INPUTS:
        assert whole["channels"][topic.name]["address"] == key("{rig}", topic)
        assert f"receive_{topic.name}" in operations
    for question in REQUESTS:
        name = f"{question.service}_{question.name}"
        assert whole["channels"][name]["address"] == request_key("{rig}", question)
        reply = operations[name]["reply"]["messages"][0]["$ref"]
        message = found(whole, found(whole, reply)["$ref"])
        assert message["payload"]["$ref"].endswith(f"/{question.reply.__name__}")


def test_units_and_texts_come_from_the_source() -> None:
    schemas = tree()["components"]["schemas"]
    position, applied = schemas["Position"], schemas["Applied"]
    assert position["properties"]["arms"]["items"] == {"$ref": "#/components/schemas/ArmPosition"}
    assert schemas["ArmPosition"]["properties"]["x_um"] == {
        "type": "number",
        "minimum": -1e9,
        "maximum": 1e9,
        "description": "Position; it increases towards the part.",
        "x-unit": "µm",
    }
    assert "own sampling grid" in position["description"]
    assert "voltage was kept" in applied["properties"]["answered"]["description"]
    assert schemas["ArmEstimate"]["properties"]["zero_age_s"] == {
        "oneOf": [{"type": "number", "minimum": -1e12, "maximum": 1e12}, {"type": "null"}],
        "x-unit": "s",
    }


def test_sent_messages_match_the_document() -> None:
    program = plan_job(GripJobRequest(kind="grip"), demo_rig()).program
    applied = Applied(
        1,
        0,
        (ArmApplied(1.5, 0),),
        Mode.ARMED,
        Cause.NONE,
        False,
        False,
        False,
        answered=True,
        refused=0,
        command_age_s=0.001,
    )
    components = tree()["components"]
    for message in (
        Position(1, 0, 0.0, (ArmPosition(1.5, valid=True),)),
        applied,
        Load(program),
        Action(ActionCode.STOP),
    ):
        name = type(message).__name__
        schema = {"$ref": f"#/components/schemas/{name}", "components": components}
        validator = jsonschema_rs.Draft7Validator(schema)
        payload = msgpack.unpackb(encode(message))
        assert [error.message for error in validator.iter_errors(payload)] == []
        for field in payload:
            less = {other: value for other, value in payload.items() if other != field}
            assert not validator.is_valid(less), field
            assert not validator.is_valid(payload | {field: [[]]}), field


def test_a_listener_learns_version_and_connection() -> None:
    whole = json.loads(document())
    assert whole["asyncapi"] == "3.0.0"
    assert ROOT.endswith(f"/{whole['info']['x-pincette-wire']}")
    variables = whole["servers"]["router"]["variables"]
    assert variables["port"]["default"] == str(Bus().port)


def test_a_type_that_the_codec_does_not_support_has_no_schema() -> None:
    with pytest.raises(TypeError, match="Bytes"):
        type_schema(inspect.type_info(bytes))
