"""The generated pages of REST and of the rig file are complete, and state the right units."""

import json
import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest

from pincette.asyncapi.schemas import notes
from pincette.config import RigFile, Table
from pincette.config.reading import read_rig

ROW = re.compile(r"^\| `(\w+)`[^|]*\| ([^|]*)\| ([^|]*)\| ([^|]*)\|", re.MULTILINE)
LINK = re.compile(r"\]\(#([\w-]+)\)")


@pytest.fixture(scope="module")
def rest(root: Path) -> str:
    return (root / "docs/reference/rest.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def configuration(root: Path) -> str:
    return (root / "docs/reference/configuration.md").read_text(encoding="utf-8")


def part(page: str, head: str) -> str:
    """Return the text below a heading."""
    return re.split(r"^##", page.split(f"\n{head}\n", 1)[1], maxsplit=1, flags=re.MULTILINE)[0]


def test_every_path_and_model_of_rest_is_listed(root: Path, rest: str) -> None:
    tree = json.loads((root / "deploy/openapi.json").read_text(encoding="utf-8"))
    for path, methods in tree["paths"].items():
        for method, stated in methods.items():
            section = part(rest, f"### `{method.upper()} {path}`")
            assert all(f"| `{item['name']}` |" in section for item in stated.get("parameters", ()))
            assert all(status in section for status in stated["responses"])
    for name, schema in tree["components"]["schemas"].items():
        section = part(rest, f"### {name}")
        assert all(f"| `{field}` |" in section for field in schema.get("properties", {}))


def test_a_field_of_rest_has_unit_limits_default_and_meaning(rest: str) -> None:
    section = part(rest, "### TrackJobRequest")
    meaning = "Peak-to-peak force of a sinusoid or triangle."
    assert f"| `force_pp_mN` | number or null | mN |  | > 0, ≤ 1e+15 | {meaning} |" in section
    assert "| `cycles` | whole number or null |  |  | ≥ 1, ≤ 1000 |" in section
    assert '| `kind` | `"track"` |  | *required* |' in section


@pytest.mark.parametrize("page", ["rest", "configuration"])
def test_every_link_within_a_page_is_resolved(page: str, request: pytest.FixtureRequest) -> None:
    text: str = request.getfixturevalue(page)
    heads = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    anchors = {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}
    assert set(LINK.findall(text)) <= anchors


def keys(tree: dict[str, Any], path: str = "") -> Iterator[tuple[str, str]]:
    """Return each table and key of a rig file, as it was parsed."""
    for name, value in tree.items():
        place = f"{path}.{name}" if path else name
        if isinstance(value, dict) and name not in ("options", "required"):
            yield from keys(value, place)  # pyright: ignore[reportUnknownArgumentType]
        elif path:
            yield path, name


def test_every_key_of_our_rig_files_is_listed(root: Path, configuration: str) -> None:
    files = sorted((root / "deploy/rigs").glob("*.toml"))
    assert files
    for file in files:
        for table, name in keys(read_rig(file).model_dump(exclude_none=True)):
            if f"## `[[{table}.{name}]]`" not in configuration:
                assert f"\n| `{name}`" in part(configuration, f"## `[{table}]`"), f"{table}.{name}"


def tables(kind: Any, seen: set[type[Table]]) -> set[type[Table]]:
    """Return every table that a rig file can have."""
    if isinstance(kind, type) and issubclass(kind, Table) and kind not in seen:
        seen.add(kind)
        for field in kind.model_fields.values():
            tables(field.annotation, seen)
    for inner in get_args(kind):
        tables(inner, seen)
    return seen


def test_every_key_of_a_rig_file_has_a_meaning() -> None:
    bare = {
        f"{kind.__name__}.{name}"
        for kind in tables(RigFile, set()) - {RigFile}
        for name in kind.model_fields
        if name not in notes(kind)
    }
    assert bare == set()


def test_units_of_the_rig_file_are_those_of_the_quantities(configuration: str) -> None:
    wanted = {
        ("[model.free_response]", "fadings_per_V"): "1/V",
        ("[model.free_response]", "curvature_um_per_V2"): "µm/V²",
        ("[model]", "creep_mN_per_decade"): "mN/decade",
        ("[law]", "B"): "mN·s/µm",
        ("[simulation.part]", "density_kg_per_m3"): "kg/m³",
        ("[simulation.hysteresis]", "A_over_d"): "1",
        ("[safety]", "command_age_periods"): "periods",
    }
    for (table, name), unit in wanted.items():
        rows = {
            found[0]: found[2].strip()
            for found in ROW.findall(part(configuration, f"## `{table}`"))
        }
        assert rows[name] == unit


def test_a_schema_is_described_in_words(root: Path) -> None:
    words = runpy.run_path(str(root / "docs/schema_words.py"))
    schema = {
        "anyOf": [
            {"type": "array", "items": {"type": "number", "minimum": 2}, "maxItems": 3},
            {"type": "object", "additionalProperties": {"type": "integer", "exclusiveMaximum": 9}},
            {"$ref": "#/components/schemas/Thing"},
            {"type": "null"},
        ]
    }
    reported = words["type_words"](schema, "<{}>".format)
    assert reported == "list of number or map of whole number or <Thing> or null"
    assert words["limit_words"](schema) == "at most 3 entries, each ≥ 2, each < 9"
