"""JSON Schema of what a payload holds once its MessagePack is unpacked."""

from dataclasses import fields, is_dataclass
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from pincette.asyncapi.fields import notes, summary
from pincette.codec import MAX_DOCUMENT, MAX_ITEMS, MAX_TEXT
from pincette.messages import Document
from pincette.records.units import unit_of

Json = dict[str, Any]

PLAIN: dict[Any, Json] = {
    float: {"type": "number"},
    int: {"type": "integer"},
    bool: {"type": "boolean"},
    str: {"type": "string", "maxLength": MAX_TEXT},
    Document: {"type": "string", "maxLength": MAX_DOCUMENT},
}
NULL = {"type": "null"}


def record_schema(kind: type) -> Json:
    """The schema of a record: a map that has every field, by name, and no other."""
    hints, texts = get_type_hints(kind), notes(kind)
    names = [field.name for field in fields(kind)]
    tree: Json = {"type": "object", "description": summary(kind), "additionalProperties": False}
    if names:
        tree["required"] = names
        tree["properties"] = {name: _field(name, hints[name], texts) for name in names}
    return tree


def _field(name: str, hint: Any, texts: dict[str, str]) -> Json:
    tree = type_schema(hint)
    about: Json = {"description": texts[name]} if name in texts else {}
    if unit_of(name):
        about["x-unit"] = unit_of(name)
    # Beside a reference nothing else counts, so a reference is wrapped.
    return {"allOf": [tree], **about} if about and "$ref" in tree else tree | about


def type_schema(hint: Any) -> Json:
    """The schema of a field's type; records are referred to by name.

    Raises
    ------
    TypeError
        Where a message has a field of a type that the codec does not carry.
    """
    if hint in PLAIN:
        return PLAIN[hint]
    if is_dataclass(hint) and isinstance(hint, type):
        return {"$ref": f"#/components/schemas/{hint.__name__}"}
    arguments = get_args(hint)
    if get_origin(hint) is Literal:
        return {"enum": list(arguments)}
    if get_origin(hint) is tuple:
        return {"type": "array", "maxItems": MAX_ITEMS, "items": type_schema(arguments[0])}
    if get_origin(hint) in (Union, UnionType):
        choices = [NULL if item is type(None) else type_schema(item) for item in arguments]
        return {"oneOf": choices}
    raise TypeError(f"no schema for a field of type {hint}")
