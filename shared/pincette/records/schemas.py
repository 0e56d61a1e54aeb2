"""Messages as Protocol Buffers, so that other tools can decode a record with what is in it.

The descriptors are made of the message dataclasses when the program starts; no schema is written
twice. Names, units included, are those of the dataclasses. ``float | None`` becomes an optional
field, data with fields of its own a nested message, a tuple a repeated field.
"""

from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from types import UnionType
from typing import Any, Generic, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from pincette.messages import Message
from pincette.topics import TOPICS

PACKAGE = "pincette"
M = TypeVar("M", bound=Message)

_Proto = descriptor_pb2.FieldDescriptorProto
_SCALARS: dict[Any, Any] = {
    float: _Proto.TYPE_DOUBLE,
    int: _Proto.TYPE_INT64,
    bool: _Proto.TYPE_BOOL,
    str: _Proto.TYPE_STRING,
}


@dataclass(frozen=True, slots=True)
class Schema(Generic[M]):
    """How one message is written and read."""

    name: str
    """Full name of the Protobuf message."""
    descriptor: bytes
    """A ``FileDescriptorSet``, as MCAP wants it."""
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
    to_proto, from_proto = _writer(kind), _reader(kind)

    def pack(message: M) -> bytes:
        return cast(bytes, proto(**to_proto(message)).SerializeToString())

    def unpack(payload: bytes) -> M:
        return cast(M, from_proto(proto.FromString(payload)))

    files = descriptor_pb2.FileDescriptorSet(file=[file])
    return Schema(full_name, files.SerializeToString(deterministic=True), pack, unpack)


def unpacker(topic: str, descriptor: bytes) -> Callable[[bytes], Any]:
    """How a message is read by the schema of its own file, which may be older than this program.

    Fields that the file does not know get their defaults.

    Raises
    ------
    ValueError
        Where the file does not know a field that has none.
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
            f"{topic}: this record is of another version: no {error.args[0]} in it"
        ) from None
    proto: Any = message_factory.GetMessageClass(described)
    return lambda payload: from_proto(proto.FromString(payload))


def _needed(field: "Field[Any]") -> bool:
    return field.default is MISSING and field.default_factory is MISSING


def _describe(kind: type, into: descriptor_pb2.DescriptorProto, within: str) -> None:
    into.name = kind.__name__
    full_name = f"{within}.{kind.__name__}"
    hints = get_type_hints(kind)
    for number, field in enumerate(fields(kind), start=1):
        hint, optional, repeated = _plain(hints[field.name])
        entry = into.field.add(name=field.name, number=number)
        entry.label = _Proto.LABEL_REPEATED if repeated else _Proto.LABEL_OPTIONAL
        if is_dataclass(hint):
            nested = cast(type, hint)
            entry.type = _Proto.TYPE_MESSAGE
            entry.type_name = f".{full_name}.{nested.__name__}"
            if nested.__name__ not in [there.name for there in into.nested_type]:
                _describe(nested, into.nested_type.add(), full_name)
            continue
        entry.type = _SCALARS[hint]
        if optional:
            # An optional scalar is the only member of a oneof that no tool shows.
            entry.proto3_optional = True
            entry.oneof_index = len(into.oneof_decl)
            into.oneof_decl.add(name=f"_{field.name}")


def _alike(described: descriptor_pb2.DescriptorProto) -> bool:
    """Whether two names differ by underscores and capitals alone, as ``cycles`` and ``cycle_s``.

    Their names in JSON would be the same to some tools, which then refuse proto3.
    """
    names = [field.name.replace("_", "").lower() for field in described.field]
    return len(set(names)) < len(names) or any(_alike(inner) for inner in described.nested_type)


def _without_proto3(described: descriptor_pb2.DescriptorProto) -> None:
    """Make optional fields those of proto2, where every field is one."""
    for field in described.field:
        field.ClearField("proto3_optional")
        field.ClearField("oneof_index")
    described.ClearField("oneof_decl")
    for inner in described.nested_type:
        _without_proto3(inner)


def _plain(hint: Any) -> tuple[Any, bool, bool]:
    """Type without its frame, whether it may be None, whether there are several."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        (inner,) = (item for item in arguments if item is not type(None))
        return _plain(inner)[0], True, False
    if origin is tuple:
        return arguments[0], False, True
    if origin is Literal:
        return str, False, False
    return getattr(hint, "__supertype__", hint), False, False


def _writer(kind: type) -> Callable[[Any], dict[str, Any]]:
    """From a message to what its Protobuf class is made of."""
    hints = get_type_hints(kind)
    plain: list[str] = []
    nested: list[tuple[str, Callable[[Any], Any]]] = []
    for field in fields(kind):
        hint, _, repeated = _plain(hints[field.name])
        if is_dataclass(hint):
            inner = _writer(cast(type, hint))
            nested.append((field.name, _each(inner) if repeated else inner))
        else:
            plain.append(field.name)

    def write(message: Any) -> dict[str, Any]:
        tree = {name: getattr(message, name) for name in plain}
        for name, inner in nested:
            value = getattr(message, name)
            tree[name] = None if value is None else inner(value)
        return tree

    return write


def _each(inner: Callable[[Any], dict[str, Any]]) -> Callable[[Any], list[dict[str, Any]]]:
    return lambda items: [inner(item) for item in items]


def _reader(kind: type, described: Any = None) -> Callable[[Any], Any]:
    """From a Protobuf message back to ours; what was None was never written.

    ``described`` is what a file says of the message, where that may be older than this program:
    fields that it does not know get their defaults. Raises KeyError where one has none.
    """
    hints = get_type_hints(kind)
    there = None if described is None else described.fields_by_name
    takes: dict[str, Callable[[Any], Any]] = {}
    for field in fields(kind):
        if there is None or field.name in there:
            inner = None if there is None else there[field.name].message_type
            takes[field.name] = _taker(field.name, hints[field.name], inner)
    odd = [field.name for field in fields(kind) if field.name not in takes and _needed(field)]
    if odd:
        raise KeyError(", ".join(odd))
    return lambda proto: kind(**{name: take(proto) for name, take in takes.items()})


def _taker(name: str, hint: Any, described: Any = None) -> Callable[[Any], Any]:
    inner, optional, repeated = _plain(hint)
    if is_dataclass(inner):
        read = _reader(cast(type, inner), described)
        if repeated:
            return lambda proto: tuple([read(item) for item in getattr(proto, name)])
        if optional:
            return lambda proto: read(getattr(proto, name)) if proto.HasField(name) else None
        return lambda proto: read(getattr(proto, name))
    if repeated:
        return lambda proto: tuple(getattr(proto, name))
    if optional:
        return lambda proto: getattr(proto, name) if proto.HasField(name) else None
    return lambda proto: getattr(proto, name)


SCHEMAS: dict[str, Schema[Any]] = {topic.name: _schema(topic.message) for topic in TOPICS}
"""For each topic, by its name."""
