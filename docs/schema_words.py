"""JSON schemas in words, for the reference pages: type, limits and default of a value."""

import json
from collections.abc import Callable, Iterator
from typing import Any

Schema = dict[str, Any]
PLAIN = {
    "number": "number",
    "integer": "whole number",
    "boolean": "true or false",
    "string": "text",
    "null": "null",
}
BOUNDS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
LENGTHS = {
    "string": ("minLength", "maxLength", "characters"),
    "array": ("minItems", "maxItems", "entries"),
    "object": ("minProperties", "maxProperties", "entries"),
}


def cell(text: str) -> str:
    """Return a text escaped for a table cell."""
    return " ".join(text.split()).replace("``", "`").replace("|", r"\|")


def table(*rows: tuple[str, ...]) -> str:
    """Return a table in Markdown; the first row is the header."""
    first, *rest = ("| " + " | ".join(row) + " |\n" for row in rows)
    return first + "|" + " --- |" * len(rows[0]) + "\n" + "".join(rest) + "\n"


def variants(schema: Schema) -> list[Schema]:
    """Return the schemas of the alternatives for a value; one if there is no choice."""
    return [part for key in ("anyOf", "oneOf") for part in schema.get(key, ())] or [schema]


def is_null(schema: Schema) -> bool:
    """Return whether a schema admits only null."""
    return schema.get("type") == "null"


def type_words(schema: Schema, link: Callable[[str], str]) -> str:
    """Return the type of a value in words; ``link`` turns the name of a schema into a link."""
    return " or ".join(dict.fromkeys(_one(part, link) for part in variants(schema)))


def _one(schema: Schema, link: Callable[[str], str]) -> str:
    if "$ref" in schema:
        return link(schema["$ref"].rpartition("/")[2])
    if "const" in schema:
        return f"`{json.dumps(schema['const'], ensure_ascii=False)}`"
    if "enum" in schema:
        return ", ".join(f"`{json.dumps(value)}`" for value in schema["enum"])
    kind = schema.get("type")
    if kind == "array":
        return f"list of {type_words(schema.get('items', {}), link)}"
    if kind == "object":
        inner = schema.get("additionalProperties")
        patterns: dict[str, Schema] = schema.get("patternProperties", {})
        values = list(patterns.values()) or ([inner] if isinstance(inner, dict) else [])
        return f"map of {type_words(values[0], link)}" if values else "map"
    return PLAIN.get(str(kind), "any value")


def limit_words(schema: Schema) -> str:
    """Return the limits of a value, of its entries and of its keys."""
    limits = (limit.replace("each each", "each") for limit in _limits(schema))
    return ", ".join(dict.fromkeys(limits))


def _limits(schema: Schema) -> Iterator[str]:
    for part in variants(schema):
        if part is not schema:
            yield from _limits(part)
            continue
        yield from (f"{sign} {part[name]:g}" for name, sign in BOUNDS.items() if name in part)
        least, most, what = LENGTHS.get(str(part.get("type")), ("", "", ""))
        if least in part or most in part:
            yield _span(part.get(least), part.get(most), what)
        if "pattern" in part:
            yield f"`{part['pattern']}`"
        if part.get("type") == "array":
            yield from (f"each {limit}" for limit in _limits(part.get("items", {})))
        if isinstance(part.get("additionalProperties"), dict):
            yield from (f"each {limit}" for limit in _limits(part["additionalProperties"]))
        for pattern, inner in part.get("patternProperties", {}).items():
            yield f"keys `{pattern}`"
            yield from (f"each {limit}" for limit in _limits(inner))
        names: Schema = part.get("propertyNames", {})
        if "enum" in names:
            yield "keys " + ", ".join(f"`{name}`" for name in names["enum"])


def _span(least: int | None, most: int | None, what: str) -> str:
    if most is None:
        return f"at least {least} {what}"
    return f"{least} to {most} {what}" if least else f"at most {most} {what}"
