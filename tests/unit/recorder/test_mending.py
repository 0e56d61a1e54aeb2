"""Records that nobody has closed are closed, and say so."""

import json
from pathlib import Path
from typing import Any

from pincette.records import mcap_reading
from pincette_recorder import record_repair
from tests.support.recorded import loop, write


def _orphan(records: Path, name: str = "j-1") -> Path:
    folder = records / name
    folder.mkdir(parents=True)
    write(folder / "job.mcap", loop(20)[:70], finish=False)
    return folder


def _manifest(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "manifest.json").read_text(encoding="utf-8"))


def test_only_what_is_not_closed_is_found(tmp_path: Path) -> None:
    orphan = _orphan(tmp_path)
    (tmp_path / "j-2").mkdir()
    write(tmp_path / "j-2" / "job.mcap", loop(3))
    (tmp_path / "j-3").mkdir()
    assert list(record_repair.unclosed(tmp_path)) == [orphan]


def test_an_orphan_is_closed(tmp_path: Path) -> None:
    folder = _orphan(tmp_path)
    closing = record_repair.mend(folder, record_repair.KILLED)
    assert closing["messages"] == "70"
    assert mcap_reading.is_closed(folder / "job.mcap")
    assert mcap_reading.read(folder / "job.mcap").messages == loop(20)[:70]
    manifest = _manifest(folder)
    assert manifest["complete"] is False
    assert manifest["detail"].startswith(record_repair.KILLED)
    assert manifest["job"] == "j-1"
    assert [entry["name"] for entry in manifest["files"]] == [
        "job.mcap",
        "samples.parquet",
        "burst.parquet",
    ]
    assert list(record_repair.unclosed(tmp_path)) == []


def test_what_the_manifest_says_already_stays(tmp_path: Path) -> None:
    folder = _orphan(tmp_path)
    told: dict[str, Any] = {
        "model_version": "3",
        "complete": False,
        "detail": "the disk was full",
        "files": [],
    }
    (folder / "manifest.json").write_text(json.dumps(told), encoding="utf-8")
    record_repair.mend(folder, record_repair.KILLED)
    manifest = _manifest(folder)
    assert manifest["model_version"] == "3"
    assert manifest["detail"].startswith("the disk was full")
    assert len(manifest["files"]) == 3


def test_an_empty_file_is_closed_too(tmp_path: Path) -> None:
    folder = tmp_path / "j-1"
    folder.mkdir()
    (folder / "job.mcap").write_bytes(b"")
    closing = record_repair.mend(folder, record_repair.KILLED)
    assert closing["messages"] == "0"
    assert "control period" in closing["detail"]
    assert mcap_reading.is_closed(folder / "job.mcap")
