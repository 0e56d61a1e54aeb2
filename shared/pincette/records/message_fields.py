"""Fields of messages as their classes declare them, for records."""

from functools import cache
from typing import cast

from msgspec import inspect

from pincette.core.messages import Message


@cache  # The 65 columns of a record are fields of twelve classes.
def fields_of(kind: type) -> tuple[inspect.Field, ...]:
    """Return the fields of a message's class, or of the class of a record within a message."""
    return cast(inspect.StructType, inspect.type_info(kind)).fields


def scalar_of(kind: type[Message], field: str) -> type[inspect.Type]:
    """Return the type of a field, without None if it is optional.

    It is ``VarTupleType`` for several values.
    """
    (node,) = (item.type for item in fields_of(kind) if item.name == field)
    inner, _, repeated = plain_type(node)
    return inspect.VarTupleType if repeated else type(inner)


def plain_type(node: inspect.Type) -> tuple[inspect.Type, bool, bool]:
    """Return the inner type, whether it may be None, and whether there are several."""
    match node:
        case inspect.UnionType():
            inner = [item for item in node.types if not is_none(item)]
            optional = len(inner) < len(node.types)
            return (plain_type(inner[0])[0] if len(inner) == 1 else node), optional, False
        case inspect.VarTupleType():
            return plain_type(node.item_type)[0], False, True
        case inspect.Metadata():
            return plain_type(node.type)
        case _:
            return node, False, False


def is_none(node: inspect.Type) -> bool:
    """Return whether a type is that of None."""
    return isinstance(node, inspect.NoneType)
