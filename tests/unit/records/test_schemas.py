"""Messages as Protobuf: nothing is lost, and a file contains its own schema."""

import struct
from typing import Any

import pytest
from google.protobuf import descriptor_pb2
from msgspec.structs import fields

from pincette.core.messages import Estimate, Message
from pincette.core.topics import TOPICS
from pincette.records import schemas
from pincette.records.schemas import SCHEMAS
from tests.support.recorded import asked, loop, name_of, notice, timing


def _bits(message: Message) -> list[Any]:
    values = [getattr(message, field.name) for field in fields(message)]
    return [struct.pack("<d", value) if type(value) is float else value for value in values]


@pytest.mark.parametrize(
    "message",
    [*loop(4), notice(), asked(), timing("sensor", 3, 0.001, 0.002)],
    ids=lambda m: f"{type(m).__name__}",
)
def test_a_message_is_read_back_bit_for_bit(message: Message) -> None:
    schema = SCHEMAS[name_of(message)]
    back = schema.unpack(schema.pack(message))
    assert back == message
    assert _bits(back) == _bits(message)


def test_every_topic_has_a_schema_with_the_fields_of_its_message() -> None:
    for topic in TOPICS:
        files = descriptor_pb2.FileDescriptorSet.FromString(SCHEMAS[topic.name].descriptor)
        (described,) = files.file[0].message_type
        assert [field.name for field in described.field] == [
            field.name for field in fields(topic.message)
        ]


def test_fields_that_may_be_absent_are_optional() -> None:
    files = descriptor_pb2.FileDescriptorSet.FromString(SCHEMAS["estimate"].descriptor)
    (described,) = files.file[0].message_type
    (arm,) = [inner for inner in described.nested_type if inner.name == "ArmEstimate"]
    optional = [field.name for field in arm.field if field.proto3_optional]
    assert optional == ["zero_age_s", "touch_x_um", "touch_mN", "stroke_change", "stroke_limit"]


def _without(descriptor: bytes, name: str) -> bytes:
    files = descriptor_pb2.FileDescriptorSet.FromString(descriptor)
    (described,) = files.file[0].message_type
    kept = [field for field in described.field if field.name != name]
    for number, field in enumerate(kept, start=1):
        field.number = number
    del described.field[:]
    described.field.extend(kept)
    return files.SerializeToString()


def test_an_older_file_is_read_by_its_own_schema() -> None:
    older = _without(SCHEMAS["estimate"].descriptor, "fault")
    message = next(item for item in loop(3) if isinstance(item, Estimate))
    read = schemas.unpacker("estimate", older)
    assert read(SCHEMAS["estimate"].pack(message)) == message


def test_a_file_without_a_required_field_is_refused() -> None:
    older = _without(SCHEMAS["estimate"].descriptor, "arms")
    with pytest.raises(ValueError, match="it has no arms"):
        schemas.unpacker("estimate", older)
