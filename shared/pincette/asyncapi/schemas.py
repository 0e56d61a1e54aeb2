"""Messages, generated from their source: JSON Schema, texts, and the records in each message."""

import ast
import inspect as python_inspect
import textwrap
from collections.abc import Iterable
from typing import Any

from msgspec import Struct, inspect

from pincette.core.units import unit_of

Json = dict[str, Any]


def summary(kind: type) -> str:
    """Return the first paragraph of a record's docstring, in Markdown, on one line."""
    return _plain((python_inspect.getdoc(kind) or "").split("\n\n")[0])


def notes(kind: type) -> dict[str, str]:
    """Return the docstring under each field in the source, in Markdown.

    Fields without a docstring are omitted.
    """
    bases = [base for base in kind.__mro__ if issubclass(base, Struct) and base is not Struct]
    found: dict[str, str] = {}
    for base in reversed(bases or [kind]):
        found |= _notes_of(base)
    return found


def _notes_of(kind: type) -> dict[str, str]:
    """Return the docstrings of the fields that a class defines itself."""
    (tree,) = ast.parse(textwrap.dedent(python_inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    found: dict[str, str] = {}
    for field, after in zip(tree.body, tree.body[1:], strict=False):
        match field, after:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                value=ast.Constant(value=str(text))
            ):
                found[name] = _plain(text)
            case _:
                pass
    return found


def reachable(kinds: Iterable[type]) -> list[type]:
    """Return these records and all records that their fields contain, each once."""
    found: dict[type, None] = {}
    for kind in kinds:
        _collect(inspect.type_info(kind), found)
    return list(found)


def _collect(node: inspect.Type, found: dict[type, None]) -> None:
    match node:
        case inspect.StructType() if node.cls not in found:
            found[node.cls] = None
            for field in node.fields:
                _collect(field.type, found)
        case inspect.VarTupleType():
            _collect(node.item_type, found)
        case inspect.UnionType():
            for item in node.types:
                _collect(item, found)
        case inspect.Metadata():
            _collect(node.type, found)
        case _:
            pass


def _plain(text: str) -> str:
    return " ".join(text.split()).replace("``", "`")


def record_schema(kind: type) -> Json:
    """Return the schema of a record: a map of its fields by name; other fields are forbidden."""
    node, texts = inspect.type_info(kind), notes(kind)
    assert isinstance(node, inspect.StructType)
    tree: Json = {"type": "object", "description": summary(kind), "additionalProperties": False}
    tags: Json = {} if node.tag_field is None else {node.tag_field: {"const": node.tag}}
    if tags or node.fields:
        required = [field.name for field in node.fields]
        tree["required"] = [*tags, *required]
        tree["properties"] = tags | {
            field.name: _field(field.name, field.type, texts) for field in node.fields
        }
    return tree


def _field(name: str, node: inspect.Type, texts: dict[str, str]) -> Json:
    tree = type_schema(node)
    about: Json = {"description": texts[name]} if name in texts else {}
    if unit_of(name):
        about["x-unit"] = unit_of(name)
    # In JSON Schema, keywords beside a reference are ignored, so the reference is wrapped.
    return {"allOf": [tree], **about} if about and "$ref" in tree else tree | about


def type_schema(node: inspect.Type) -> Json:
    """Return the schema of a field's type; records are included by reference.

    Raises
    ------
    TypeError
        If a message has a field of a type that the codec does not support.
    """
    match node:
        case inspect.Metadata():
            return type_schema(node.type)
        case inspect.FloatType():
            return {"type": "number", "minimum": node.ge, "maximum": node.le}
        case inspect.IntType():
            return {"type": "integer", "minimum": node.ge, "maximum": node.le}
        case inspect.BoolType():
            return {"type": "boolean"}
        case inspect.NoneType():
            return {"type": "null"}
        case inspect.StrType():
            return {"type": "string", "maxLength": node.max_length}
        case inspect.StructType():
            return {"$ref": f"#/components/schemas/{node.cls.__name__}"}
        case inspect.LiteralType():
            return {"enum": list(node.values)}
        case inspect.EnumType():
            return {"enum": [code.value for code in node.cls]}
        case inspect.VarTupleType():
            least: Json = {} if node.min_length is None else {"minItems": node.min_length}
            items = type_schema(node.item_type)
            return {"type": "array", **least, "maxItems": node.max_length, "items": items}
        case inspect.UnionType():
            return {"oneOf": [type_schema(item) for item in node.types]}
        case _:
            raise TypeError(f"no schema for a field of type {node}")
