"""Messages as Protocol Buffers, with descriptors made from the messages' classes."""

# Other tools can decode a record without further files. Names and units are those of the classes.
# ``float | None`` becomes an optional field, a class with fields a nested message, a tuple a
# repeated field, and a union of records a nested message with one field for each of them.

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

import msgspec
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from msgspec import inspect

from pincette.core.messages import Message
from pincette.core.topics import TOPICS
from pincette.records.message_fields import fields_of, is_none, plain_type

PACKAGE = "pincette"
M = TypeVar("M", bound=Message)

_Proto = descriptor_pb2.FieldDescriptorProto
_SCALARS: dict[type[inspect.Type], Any] = {
    inspect.FloatType: _Proto.TYPE_DOUBLE,
    inspect.IntType: _Proto.TYPE_INT64,
    inspect.BoolType: _Proto.TYPE_BOOL,
    inspect.StrType: _Proto.TYPE_STRING,
    inspect.LiteralType: _Proto.TYPE_STRING,
    inspect.EnumType: _Proto.TYPE_STRING,
}


@dataclass(frozen=True, slots=True)
class Schema(Generic[M]):
    """Functions that write and read one type of message."""

    name: str
    """Full name of the Protobuf message."""
    descriptor: bytes
    """Serialised ``FileDescriptorSet``, as MCAP requires."""
    pack: Callable[[M], bytes]
    unpack: Callable[[bytes], M]


def _schema(kind: type[M]) -> Schema[M]:
    file = descriptor_pb2.FileDescriptorProto(
        name=f"{PACKAGE}/{kind.__name__}.proto", package=PACKAGE, syntax="proto3"
    )
    described = file.message_type.add()
    _describe(kind, described, PACKAGE)
    if _alike(described):
        file.syntax = "proto2"
        _without_proto3(described)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    full_name = f"{PACKAGE}.{kind.__name__}"
    proto: Any = message_factory.GetMessageClass(pool.FindMessageTypeByName(full_name))
    from_proto, node = _reader(kind), inspect.type_info(kind)
    as_sent = _by_tag if _has_union(node) else _unchanged

    def pack(message: M) -> bytes:
        tree = as_sent(node, msgspec.to_builtins(message))
        return cast(bytes, proto(**tree).SerializeToString())

    def unpack(payload: bytes) -> M:
        return cast(M, from_proto(proto.FromString(payload)))

    files = descriptor_pb2.FileDescriptorSet(file=[file])
    return Schema(full_name, files.SerializeToString(deterministic=True), pack, unpack)


def unpacker(topic: str, descriptor: bytes) -> Callable[[bytes], Any]:
    """Return a reader of messages by the schema of an older file.

    Raises ValueError for a missing field.
    """
    known = SCHEMAS[topic]
    if descriptor == known.descriptor:
        return known.unpack
    kind = next(item.message for item in TOPICS if item.name == topic)
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(descriptor).file:
        pool.Add(file)
    described = pool.FindMessageTypeByName(known.name)
    try:
        from_proto = _reader(kind, described)
    except KeyError as error:
        raise ValueError(
            f"{topic}: this record is from another version: it has no {error.args[0]}"
        ) from None
    proto: Any = message_factory.GetMessageClass(described)
    return lambda payload: from_proto(proto.FromString(payload))


def _describe(kind: type, into: descriptor_pb2.DescriptorProto, within: str) -> None:
    into.name = kind.__name__
    full_name = f"{within}.{kind.__name__}"
    for number, field in enumerate(fields_of(kind), start=1):
        node, optional, repeated = plain_type(field.type)
        entry = into.field.add(name=field.name, number=number)
        entry.label = _Proto.LABEL_REPEATED if repeated else _Proto.LABEL_OPTIONAL
        if isinstance(node, inspect.UnionType):
            entry.type = _Proto.TYPE_MESSAGE
            entry.type_name = f".{full_name}.{_union_name(field)}"
            _describe_union(node, into.nested_type.add(name=_union_name(field)), full_name)
            continue
        if isinstance(node, inspect.StructType):
            nested = node.cls
            entry.type = _Proto.TYPE_MESSAGE
            entry.type_name = f".{full_name}.{nested.__name__}"
            if nested.__name__ not in [there.name for there in into.nested_type]:
                _describe(nested, into.nested_type.add(), full_name)
            continue
        entry.type = _SCALARS[type(node)]
        if optional:
            # An optional scalar is represented by a oneof with one member, which tools do not show.
            entry.proto3_optional = True
            entry.oneof_index = len(into.oneof_decl)
            into.oneof_decl.add(name=f"_{field.name}")


def _union_name(field: inspect.Field) -> str:
    return field.name.capitalize()


def _describe_union(
    node: inspect.UnionType, into: descriptor_pb2.DescriptorProto, within: str
) -> None:
    """Describe a union of records as a message with one field for each, of which one is set."""
    full_name, records = f"{within}.{into.name}", _records(node)
    into.oneof_decl.add(name=records[0].tag_field)
    for number, record in enumerate(records, start=1):
        type_name = f".{full_name}.{record.cls.__name__}"
        into.field.add(
            name=str(record.tag),
            number=number,
            label=_Proto.LABEL_OPTIONAL,
            type=_Proto.TYPE_MESSAGE,
            type_name=type_name,
            oneof_index=0,
        )
        _describe(record.cls, into.nested_type.add(), full_name)


def _records(node: inspect.UnionType) -> list[inspect.StructType]:
    """Return the records of a union, in its order."""
    return [item for item in node.types if isinstance(item, inspect.StructType)]


def _has_union(node: inspect.Type) -> bool:
    """Return whether a type contains a union of records."""
    match node:
        case inspect.Metadata():
            return _has_union(node.type)
        case inspect.StructType():
            return any(_has_union(field.type) for field in node.fields)
        case inspect.UnionType():
            return len(_records(node)) > 1 or any(_has_union(item) for item in node.types)
        case inspect.VarTupleType():
            return _has_union(node.item_type)
        case _:
            return False


def _unchanged(_node: inspect.Type, value: Any) -> Any:
    return value


def _by_tag(node: inspect.Type, value: Any) -> Any:
    """Return a tree of values with each record of a union in the field named by its tag."""
    if value is None:
        return None
    match node:
        case inspect.Metadata():
            return _by_tag(node.type, value)
        case inspect.UnionType():
            records = {record.tag: record for record in _records(node)}
            if len(records) < 2:
                return _by_tag(next(t for t in node.types if not is_none(t)), value)
            tag_field = str(next(iter(records.values())).tag_field)
            fields = {name: inner for name, inner in value.items() if name != tag_field}
            return {value[tag_field]: _by_tag(records[value[tag_field]], fields)}
        case inspect.StructType():
            types = {field.name: field.type for field in node.fields}
            return {name: _by_tag(types[name], inner) for name, inner in value.items()}
        case inspect.VarTupleType():
            return [_by_tag(node.item_type, item) for item in value]
        case _:
            return value


def _alike(described: descriptor_pb2.DescriptorProto) -> bool:
    """Return whether field names such as ``cycles`` and ``cycle_s`` have the same JSON name,
    which proto3 refuses."""
    names = [field.name.replace("_", "").lower() for field in described.field]
    return len(set(names)) < len(names) or any(_alike(inner) for inner in described.nested_type)


def _without_proto3(described: descriptor_pb2.DescriptorProto) -> None:
    """Turn optional fields into fields of proto2, in which every field is optional."""
    # A message that represents a union has no optional fields, and keeps its choice.
    if any(field.proto3_optional for field in described.field):
        for field in described.field:
            field.ClearField("proto3_optional")
            field.ClearField("oneof_index")
        described.ClearField("oneof_decl")
    for inner in described.nested_type:
        _without_proto3(inner)


def _reader(kind: type, described: Any = None) -> Callable[[Any], Any]:
    """Return a reader for a Protobuf message, by a file's descriptor or the present one."""
    # Fields that an older file does not contain get their defaults; KeyError without a default.
    there = None if described is None else described.fields_by_name
    takes: dict[str, Callable[[Any], Any]] = {}
    missing: list[str] = []
    for field in fields_of(kind):
        if there is None or field.name in there:
            inner = None if there is None else there[field.name].message_type
            takes[field.name] = _taker(field, inner)
        elif field.required:
            missing.append(field.name)
    if missing:
        raise KeyError(", ".join(missing))
    return lambda proto: kind(**{name: take(proto) for name, take in takes.items()})


def _taker(field: inspect.Field, described: Any = None) -> Callable[[Any], Any]:
    name = field.name
    inner, optional, repeated = plain_type(field.type)
    read: Callable[[Any], Any] = _same
    if isinstance(inner, inspect.UnionType):
        read = _union_reader(inner, described)
    elif isinstance(inner, inspect.StructType):
        read = _reader(inner.cls, described)
    elif isinstance(inner, inspect.EnumType):
        read = inner.cls
    if repeated:
        return lambda proto: tuple([read(item) for item in getattr(proto, name)])
    if optional:
        return lambda proto: read(getattr(proto, name)) if proto.HasField(name) else None
    return lambda proto: read(getattr(proto, name))


def _union_reader(node: inspect.UnionType, described: Any = None) -> Callable[[Any], Any]:
    """Return the reader for the message that represents a union; see ``_reader``."""
    records = _records(node)
    there = None if described is None else described.fields_by_name
    readers: dict[str, Callable[[Any], Any]] = {}
    for record in records:
        tag = str(record.tag)
        if there is None:
            readers[tag] = _reader(record.cls)
        elif tag in there:
            readers[tag] = _reader(record.cls, there[tag].message_type)
    tag_field = str(records[0].tag_field)

    def read(proto: Any) -> Any:
        tag = proto.WhichOneof(tag_field)
        return readers[tag](getattr(proto, tag))

    return read


def _same(value: Any) -> Any:
    return value


SCHEMAS: dict[str, Schema[Any]] = {topic.name: _schema(topic.message) for topic in TOPICS}
"""Schema of each topic, by topic name."""
