"""Write docs/reference/configuration.md from the models of the rig file."""

import json
import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast, get_args

from pydantic import TypeAdapter

from pincette.asyncapi.schemas import notes
from pincette.cli.catalogue import TABLES
from pincette.config import RigFile, Table
from pincette.config.calibration import CALIBRATED, EXPECTED
from pincette.config.laws import Law, installed_laws, law_definition
from pincette.config.rig_file import UNSHARED
from pincette.core import plugins
from pincette.core.units import OF_FILES, UNITS, unit_in_file

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "reference" / "configuration.md"
OWN = ("pincette", "pincette-nidaqmx")
"""Distributions whose laws and drivers the page describes."""
words: Any = SimpleNamespace(**runpy.run_path(str(DOCS / "schema_words.py")))

LEADING = re.compile(r"([^\s.,;]+)(?:[.,;] ?| |$)")
WORD = re.compile(r"[a-z]+[ ,;]")
KNOWN_UNITS = {*UNITS.values(), *OF_FILES.values(), "1", "mN·s²/µm", "mN·s/µm", "mN/mN"}
"""Units that may begin the description of a quantity whose name has no unit suffix."""

HEAD = """\
# Configuration

Generated from the models of `pincette.config` by `make docs`; a test compares the two.

One TOML file, the rig file, describes a whole rig. Every program of the rig reads it. Its path
comes from `--rig`, else from the environment variable `PINCETTE_RIG`, else it is
[demo.toml](../../deploy/rigs/demo.toml). An unknown key, a value of another type and a value beyond
its limits are refused; the message names the place, the value and what is expected. A key without a
default is required. *none* as a default means that the key is left out.

Before the first table, `base = "FILE"` may name another rig file, relative to this one. The values
of that file apply where this file has none. That file must not have a base itself.

Letters behind a key:

- **c**: a calibration may identify it. The model in use then replaces the value of the rig file
  ([calibrate](../how-to/calibrate.md)).
- **r**: a recipe may replace it for one job ([recipes](../how-to/recipes.md)).
- **l**: local. It may differ between machines; the programs do not compare it.

"""
DRIVERS = """\
## Options of the drivers

Each driver has its own table `options` in `[sensor]` or `[output]`. `pincette doctor --drivers`
shows the options of all installed drivers, including those of
[other packages](../how-to/add-a-driver.md).

"""


def configuration_page() -> str:
    """Return the page as Markdown."""
    body = "".join(_tables(RigFile, ""))
    return (HEAD + body + DRIVERS + "".join(_drivers())).rstrip() + "\n"


def _below(annotation: Any) -> type[Table] | None:
    """Return the model of the table that a field contains directly, as an option, or in a list."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((kind for part in get_args(annotation) if (kind := _below(part))), None)


def _tables(kind: type[Table], path: str) -> Iterator[str]:
    """Return the section of a table, then those of the tables within it, at any depth."""
    inner = {name: _below(field.annotation) for name, field in kind.model_fields.items()}
    if path:
        yield f"## {_head(path)}\n\n{words.cell(kind.__doc__ or '')}\n\n"
        yield _rows(kind, path, [name for name, below in inner.items() if below is None])
        if kind is Law:
            yield from _gains()
    for name, below in inner.items():
        if below is not None:
            place = f"{path}.{name}" if path else name
            in_list = "tuple" in str(kind.model_fields[name].annotation)
            yield from _tables(below, f"{place}[]" if in_list else place)


def _gains() -> Iterator[str]:
    """Return the gains of each law of the project."""
    for entry in plugins.registered(plugins.LAWS):
        if plugins.origin(entry).partition(" ")[0] not in OWN:
            continue
        if entry.name not in installed_laws():
            continue  # only for two arms: a rig file does not name it
        law = law_definition(entry.name)
        yield f'With `scheme = "{law.name}"`, {law.title}, {words.cell(law.summary)}:\n\n'
        rows = [
            (
                f"`{gain.name}`",
                "number",
                gain.unit,
                f"`{gain.default!r}`",
                "> 0" if gain.positive else "≥ 0",
                words.cell(gain.meaning[0].upper() + gain.meaning[1:] + "."),
            )
            for gain in law.parameters
        ]
        yield words.table(("key", "type", "unit", "default", "limits", "meaning"), *rows)


def _head(path: str) -> str:
    return f"`[[{path.removesuffix('[]')}]]`" if path.endswith("[]") else f"`[{path}]`"


def _rows(kind: type[Table], path: str, names: list[str]) -> str:
    properties, texts = kind.model_json_schema()["properties"], notes(kind)
    rows: list[tuple[str, ...]] = []
    for name in names:
        schema = _said(properties[name])
        unit, text = _unit_and_text(name, texts[name])
        rows.append(
            (
                f"`{name}`{_marks(path, name)}",
                words.type_words(schema, str),
                unit,
                _default(kind, name),
                words.cell(words.limit_words(schema)),
                words.cell(text),
            )
        )
    return words.table(("key", "type", "unit", "default", "limits", "meaning"), *rows)


def _unit_and_text(name: str, text: str) -> tuple[str, str]:
    """Return the unit, from the start of a description or from the name, and the rest of the
    description.
    """
    found = LEADING.match(text)
    if found is None or found[1] not in KNOWN_UNITS:
        return unit_in_file(f"_{name}"), text
    rest = text[found.end() :]
    return found[1], rest[:1].upper() + rest[1:] if WORD.match(rest) else rest


def _said(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema without its null alternative, which TOML does not have."""
    parts = [part for part in words.variants(schema) if not words.is_null(part)]
    return parts[0] if len(parts) == 1 else {"anyOf": parts}


def _default(kind: type[Table], name: str) -> str:
    field = kind.model_fields[name]
    if field.is_required():
        return ""
    value: Any = field.get_default(call_default_factory=True)
    if value is None:
        return "*none*"
    text: str = json.dumps(TypeAdapter(Any).dump_python(value, mode="json"), ensure_ascii=False)
    return f"`{text}`"


def _marks(path: str, name: str) -> str:
    quantity, local = f"{path}.{name}", UNSHARED.get(path, ())
    marks = [
        letter
        for letter, holds in (
            ("c", quantity in CALIBRATED),
            ("r", quantity in EXPECTED),
            ("l", local is True or name in cast("set[str]", local) or _untold(path, name)),
        )
        if holds
    ]
    return f" **{', '.join(marks)}**" if marks else ""


def _untold(path: str, name: str) -> bool:
    """Return whether a key is omitted from the messages between the programs."""
    field = RigFile.model_fields.get(path)
    kind = None if field is None else _below(field.annotation)
    return kind is not None and bool(kind.model_fields[name].exclude)


def _drivers() -> Iterator[str]:
    for group, rig_table in TABLES.items():
        for entry in plugins.registered(group):
            if plugins.origin(entry).partition(" ")[0] not in OWN:
                continue
            plugins.load(group, entry.name)
            for name, thing in vars(sys.modules[entry.module]).items():
                own = isinstance(thing, type) and thing.__module__ == entry.module
                if own and issubclass(thing, Table) and name.endswith("Options"):
                    yield f"### `{entry.name}` in `[{rig_table}]`\n\n"
                    yield f"{words.cell(thing.__doc__ or '')}\n\n"
                    yield _rows(thing, "options", list(thing.model_fields))


PAGES = {PAGE: configuration_page}


def main() -> None:
    """Write the page."""
    PAGE.write_text(configuration_page(), encoding="utf-8")
    print(PAGE.relative_to(DOCS.parent))


if __name__ == "__main__":
    main()
