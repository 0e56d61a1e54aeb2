"""Write docs/reference/rest.md from the OpenAPI document."""

import json
import runpy
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from pincette.core.units import unit_of
from pincette_supervisor.rest.api import openapi_document

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "reference" / "rest.md"
Json = dict[str, Any]
words: Any = SimpleNamespace(**runpy.run_path(str(DOCS / "schema_words.py")))

HEAD = """\
# REST

Generated from the supervisor's OpenAPI document by `make docs`; a test compares the two. Programs
read [deploy/openapi.json](../../deploy/openapi.json), which the supervisor serves at
`/openapi.json`.

Names of fields contain the units. The supervisor refuses unknown fields and query parameters,
those that come twice, and numbers that are not finite; only an emergency stop ignores them.
An emergency stop is also accepted for every spelling of its path, for HTTP/1.0 and under every
`Host`. All other paths are exact: a wrong one gets 404, never a redirect. `HEAD` works wherever
`GET` does, `OPTIONS` names the methods of a path, and so does `Allow` of a 405. `Location` is
relative to the address of the request, so that it is right [behind a reverse
proxy](../how-to/reverse-proxy.md).
If the supervisor has [keys](../how-to/rest-keys.md), a request needs one with the scope that is
named at each path: `Authorization: Bearer KEY`. A page that has signed in sends a cookie
instead. *Required* marks a field without a default: a request must have it, and an answer always
has it.

## Errors

Every error is a [Problem](#problem), of the type `application/problem+json` (RFC 9457). Its
`type` is `urn:pincette:problem:` followed by the code in the table. The names in brackets are
further members.

"""


def rest_page() -> str:
    """Return the page as Markdown."""
    tree: Json = json.loads(openapi_document())
    errors = _errors(tree)
    parts = [HEAD, words.table(("status", "when"), *_error_rows(errors))]
    tags: dict[str, list[str]] = {}
    for path, methods in tree["paths"].items():
        for method, said in methods.items():
            text = "".join(_operation(tree, f"{method.upper()} {path}", said))
            tags.setdefault(said["tags"][0], []).append(text)
    for tag, texts in tags.items():
        parts += [f"## {tag.capitalize()}\n\n", *texts]
    parts.append("## Models\n\n")
    for name in sorted(tree["components"]["schemas"]):
        parts.append(_model(name, tree["components"]["schemas"][name]))
    return "".join(parts).rstrip() + "\n"


def _link(name: str) -> str:
    return f"[{name}](#{name.lower()})"


def _resolved(tree: Json, response: Json) -> Json:
    if "$ref" not in response:
        return response
    return tree["components"]["responses"][response["$ref"].rpartition("/")[2]]


def _errors(tree: Json) -> set[tuple[str, str]]:
    """Return the statuses from 400 on, each with its description."""
    return {
        (status, words.cell(_resolved(tree, response)["description"]))
        for methods in tree["paths"].values()
        for said in methods.values()
        for status, response in said["responses"].items()
        if status >= "400"
    }


def _error_rows(errors: set[tuple[str, str]]) -> list[tuple[str, str]]:
    return [(status, text) for status, text in sorted(errors)]


def _operation(tree: Json, head: str, said: Json) -> Iterator[str]:
    yield f"### `{head}`\n\n"
    yield "\n\n".join(map(words.cell, said["description"].split("\n\n"))) + "\n\n"
    scopes = [scope for way in said.get("security", ()) for scope in way.get("key", ())]
    wanted = f"Scope: `{scopes[0]}`." if scopes else "No key needed."
    body = said.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema")
    takes = f" Body: {words.type_words(body, _link)}." if body else ""
    yield f"{wanted}{takes}\n\n"
    rows = [_parameter(parameter) for parameter in said.get("parameters", ())]
    if rows:
        head_row = ("parameter", "in", "type", "unit", "default", "limits", "meaning")
        yield words.table(head_row, *rows)
    yield from _answers(tree, said["responses"])


def _parameter(parameter: Json) -> tuple[str, ...]:
    schema: Json = parameter["schema"]
    return (
        f"`{parameter['name']}`",
        parameter["in"],
        words.type_words(_stated(schema), _link),
        unit_of(parameter["name"]),
        "*required*" if parameter["required"] else _default(schema),
        words.cell(words.limit_words(schema)),
        words.cell(parameter.get("description", "")),
    )


def _stated(schema: Json) -> Json:
    """Return the schema without its null alternative: a parameter that is not given is omitted."""
    parts = [part for part in words.variants(schema) if not words.is_null(part)]
    return parts[0] if len(parts) == 1 else {"anyOf": parts}


def _default(schema: Json) -> str:
    value = schema.get("default")
    return "" if value is None else f"`{json.dumps(value, ensure_ascii=False)}`"


def _answers(tree: Json, responses: Json) -> Iterator[str]:
    rows: list[tuple[str, ...]] = []
    for status, response in sorted(responses.items()):
        resolved = _resolved(tree, response)
        if status < "400":
            text = resolved["description"].replace("Successful Response", "")
            rows.append((status, words.cell(text), _content(resolved.get("content", {}))))
    yield words.table(("status", "when", "answer"), *rows)
    refused = ", ".join(status for status in sorted(responses) if status >= "400")
    yield f"[Errors](#errors): {refused}.\n\n"


def _content(content: Json) -> str:
    kinds = [
        words.type_words(inner["schema"], _link)
        if kind == "application/json" and inner.get("schema")
        else f"`{kind}`"
        for kind, inner in content.items()
    ]
    return " or ".join(kinds)


def _model(name: str, schema: Json) -> str:
    description = words.cell(schema.get("description", "").split("\n\n")[0])
    head = f"### {name}\n\n{description}\n\n" if description else f"### {name}\n\n"
    if "properties" not in schema:
        return f"{head}{words.type_words(schema, _link).capitalize()}\n\n"
    required = schema.get("required", [])
    rows = [
        (
            f"`{field}`",
            words.type_words(inner, _link),
            unit_of(field),
            "*required*" if field in required else _default(inner),
            words.cell(words.limit_words(inner)),
            words.cell(inner.get("description", "")),
        )
        for field, inner in schema["properties"].items()
    ]
    table = words.table(("field", "type", "unit", "default", "limits", "meaning"), *rows)
    examples = [_shown(example) for example in schema.get("examples", ())]
    return head + table + "".join(examples)


def _shown(example: Json) -> str:
    return f"```json\n{json.dumps(example, ensure_ascii=False, indent=2)}\n```\n\n"


PAGES = {PAGE: rest_page}


def main() -> None:
    """Write the page."""
    PAGE.write_text(rest_page(), encoding="utf-8")
    print(PAGE.relative_to(DOCS.parent))


if __name__ == "__main__":
    main()
