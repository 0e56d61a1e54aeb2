"""A backup of a supervisor at work, restored into an empty folder."""

import io
import json
import sqlite3
import tarfile
from contextlib import closing
from pathlib import Path

import pytest

from pincette.cli.main import main
from pincette_supervisor.journal.recipes import RecipeRepository
from pincette_supervisor.journal.store import JobRow, Store, utc_now


@pytest.fixture
def data(tmp_path: Path) -> Path:
    data = tmp_path / "data"
    (data / "models" / "demo").mkdir(parents=True)
    (data / "models" / "demo" / "0001-abc.json").write_text('{"version": 1}', encoding="utf-8")
    (data / "keys.json").write_text('{"version": 1, "keys": []}', encoding="utf-8")
    (data / "jobs" / "a").mkdir(parents=True)
    (data / "jobs" / "a" / "result.json").write_text("{}", encoding="utf-8")
    return data


def job(name: str) -> JobRow:
    return JobRow(name, "grip", "demo", "succeeded", {}, {}, utc_now(), sample="B7")


@pytest.mark.parametrize("records", [False, True])
def test_what_a_supervisor_keeps_is_there_again(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], records: bool
) -> None:
    store = Store(data / "supervisor.sqlite")
    store.add(job("first"))
    RecipeRepository(store).add("bead", {"force_mN": 8.0}, "glass")
    file, after = tmp_path / "bench.tar.gz", tmp_path / "after"
    more = ["--records"] if records else []
    # The supervisor is at work: what it has written lies in SQLite's log beside the file.
    assert main(["backup", str(file), "--data", str(data), *more]) == 0
    store.add(job("later"))
    store.close()
    assert file.stat().st_mode & 0o077 == 0
    assert main(["restore", str(file), "--data", str(after)]) == 0
    again = Store(after / "supervisor.sqlite")
    found = again.get("first")
    assert found is not None
    assert (found.sample, again.get("later")) == ("B7", None)
    recipe = RecipeRepository(again).find("bead")
    assert recipe is not None
    assert recipe.values == {"force_mN": 8.0}
    again.close()
    for name in ("models/demo/0001-abc.json", "keys.json"):
        assert (after / name).read_bytes() == (data / name).read_bytes()
    assert (after / "jobs" / "a" / "result.json").exists() == records
    assert "pincette up --data" in capsys.readouterr().out


def test_nothing_is_restored_over_what_is_there(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Store(data / "supervisor.sqlite").close()
    file = tmp_path / "bench.tar.gz"
    assert main(["backup", str(file), "--data", str(data)]) == 0
    assert main(["restore", str(file), "--data", str(data)]) == 1
    assert "is not empty" in capsys.readouterr().err


def test_a_backup_that_was_changed_is_refused_and_leaves_nothing(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Store(data / "supervisor.sqlite").close()
    file, after = tmp_path / "bench.tar.gz", tmp_path / "after"
    assert main(["backup", str(file), "--data", str(data)]) == 0
    with tarfile.open(file) as archive:
        contents = {
            entry.name: stream.read()
            for entry in archive
            if (stream := archive.extractfile(entry)) is not None
        }
    for name, content, words in (
        ("keys.json", b"{}", "keys.json has been changed"),
        ("../evil", b"x", "no file of a backup"),
        ("backup.json", json.dumps({"files": {"gone": "0"}}).encode(), "has been changed"),
    ):
        with tarfile.open(file, "w:gz") as archive:
            for place, inner in {**contents, name: content}.items():
                entry = tarfile.TarInfo(place)
                entry.size = len(inner)
                archive.addfile(entry, io.BytesIO(inner))
        assert main(["restore", str(file), "--data", str(after)]) == 1
        assert words in capsys.readouterr().err
        assert not after.exists()


def test_a_folder_without_a_journal_is_no_data_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["backup", str(tmp_path / "b.tar.gz"), "--data", str(tmp_path)]) == 1
    assert "name the folder with --data" in capsys.readouterr().err
    with closing(sqlite3.connect(tmp_path / "supervisor.sqlite")) as base:
        base.execute("CREATE TABLE x (y)")
    assert not (tmp_path / "b.tar.gz").exists()
