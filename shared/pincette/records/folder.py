"""A job's folder: samples as Parquet with units, the request, the result, a manifest."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow
import pyarrow.parquet

from pincette.api.job_models import JobKind
from pincette.records.columns import COLUMNS, Columns

SAMPLES = "samples.parquet"
BURST = "burst.parquet"
PLOTS: Mapping[JobKind, str] = {
    "grip": "grip.png",
    "track": "track.png",
    "calibrate": "calibration.png",
}
REQUEST, RESULT, MANIFEST = "request.json", "result.json", "manifest.json"
MEDIA_TYPES = {
    SAMPLES: "application/vnd.apache.parquet",
    BURST: "application/vnd.apache.parquet",
    **dict.fromkeys(PLOTS.values(), "image/png"),
    REQUEST: "application/json",
    RESULT: "application/json",
    MANIFEST: "application/json",
}

# pyarrow carries no types.
_arrow: Any = pyarrow
_parquet: Any = pyarrow.parquet
_TYPES = {
    "float": _arrow.float64(),
    "int": _arrow.int64(),
    "bool": _arrow.bool_(),
    "text": _arrow.string(),
}


def write_samples(path: Path, table: Columns, about: Mapping[str, str]) -> None:
    """Write columns as Parquet.

    Each field's metadata holds its unit and meaning, the schema's holds ``about``.
    """

    def field(name: str, kind: str, unit: str, meaning: str) -> Any:
        return _arrow.field(name, _TYPES[kind], metadata={"unit": unit, "meaning": meaning})

    schema = _arrow.schema(
        [
            field("seq", "int", "", "number of the sample"),
            field("t_s", "float", "s", "number of the sample times the control period"),
            *(field(item.name, item.kind, item.unit, item.meaning) for item in COLUMNS),
        ],
        metadata=dict(about),
    )
    arrow_table = _arrow.Table.from_pydict(dict(table), schema=schema)
    with _Replacing(path) as draft:
        _parquet.write_table(arrow_table, str(draft), compression="zstd")


def write_burst(
    path: Path, x_um: Sequence[float], drive_V: Sequence[float], about: Mapping[str, str]
) -> None:
    """Write a buffered acquisition as Parquet; its rate is in ``about``."""
    meanings = {
        "x_um": ("µm", "position of the tip, x"),
        "drive_V": ("V", "drive at the amplifier's input, as measured"),
    }
    schema = _arrow.schema(
        [
            _arrow.field(name, _arrow.float64(), metadata={"unit": unit, "meaning": meaning})
            for name, (unit, meaning) in meanings.items()
        ],
        metadata=dict(about),
    )
    table = _arrow.Table.from_pydict({"x_um": x_um, "drive_V": drive_V}, schema=schema)
    with _Replacing(path) as draft:
        _parquet.write_table(table, str(draft), compression="zstd")


def write_json(path: Path, tree: Mapping[str, Any]) -> None:
    """Write a document that people read."""
    with _Replacing(path) as draft:
        text = json.dumps(tree, indent=2, ensure_ascii=False, allow_nan=False)
        draft.write_text(text + "\n", encoding="utf-8")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file as it is."""
    with _Replacing(path) as draft:
        draft.write_bytes(content)


class _Replacing:
    """A draft that takes the place of a file at once, so that no reader sees half of it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._draft = path.with_name(path.name + ".part")

    def __enter__(self) -> Path:
        return self._draft

    def __exit__(self, kind: type[BaseException] | None, *_rest: object) -> None:
        if kind is None:
            self._draft.replace(self._path)
        else:
            self._draft.unlink(missing_ok=True)


def artifacts(folder: Path) -> list[dict[str, Any]]:
    """Files of a record, each with its size and SHA-256."""
    found: list[dict[str, Any]] = []
    for name, media_type in MEDIA_TYPES.items():
        path = folder / name
        if path.is_file():
            content = path.read_bytes()
            found.append(
                {
                    "name": name,
                    "media_type": media_type,
                    "bytes": len(content),
                    "sha256": hashlib.sha256(content).hexdigest(),
                }
            )
    return found


def write_manifest(folder: Path, about: Mapping[str, str]) -> None:
    """Write which files the record has, and whose they are."""
    files = [entry for entry in artifacts(folder) if entry["name"] != MANIFEST]
    write_json(folder / MANIFEST, {**about, "files": files})
