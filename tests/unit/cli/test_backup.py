"""A backup of a working supervisor, restored into an empty folder."""

import io
import json
import os
import sqlite3
import tarfile
from collections.abc import Callable
from contextlib import closing
from hashlib import sha256
from pathlib import Path

import pytest

from pincette.cli.main import main
from pincette_supervisor.journal.library import RecipeRepository
from pincette_supervisor.journal.store import JobRow, Store, utc_now
from tests.support.stores import open_store


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
def test_restored_data_equals_the_saved_data(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], records: bool
) -> None:
    store = open_store(data / "supervisor.sqlite")
    store.add(job("first"))
    RecipeRepository(store).add("bead", {"force_mN": 8.0}, "glass")
    file, after = tmp_path / "bench.tar.gz", tmp_path / "after"
    more = ["--records"] if records else []
    # The supervisor is working: its writes are in SQLite's log next to the file.
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


def test_a_restore_overwrites_nothing(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    open_store(data / "supervisor.sqlite").close()
    file = tmp_path / "bench.tar.gz"
    assert main(["backup", str(file), "--data", str(data)]) == 0
    assert main(["restore", str(file), "--data", str(data)]) == 1
    assert "is not empty" in capsys.readouterr().err


def test_a_modified_backup_is_refused_and_leaves_no_files(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    open_store(data / "supervisor.sqlite").close()
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
        ("../evil", b"x", "which does not belong in a backup"),
        ("/evil", b"x", "which does not belong in a backup"),
        (".", b"x", "which does not belong in a backup"),
        ("./keys.json", b"x", "which does not belong in a backup"),
        ("models", b"x", "which does not belong in a backup"),
        ("models//x", b"x", "which does not belong in a backup"),
        ("models/../keys.json", b"x", "which does not belong in a backup"),
        ("joined/x/keys.json", b"x", "which does not belong in a backup"),
        ("supervisor.sqlite-wal", b"x", "which does not belong in a backup"),
        ("models/\udcff", b"x", "which does not belong in a backup"),
        ("models/demo", b"x", "as a file and as a folder"),
        ("models/demo/0001-abc.json/x", b"x", "as a file and as a folder"),
        ("models/new", b"x", "has been changed"),
        ("backup.json", b"[]", "lists no files"),
        ("backup.json", b'{"files": 5}', "lists no files"),
        ("backup.json", b"[" * 100_000, "cannot be restored"),
        ("backup.json", b"\xff", "cannot be restored"),
        ("backup.json", b"", "backup.json is missing"),
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


def journal_with_damaged_pages(content: bytes) -> bytes:
    return content[:8192] + b"\x5a" * (len(content) - 8192)


def journal_that_is_cut(content: bytes) -> bytes:
    return content[: len(content) // 2]


def no_journal(_content: bytes) -> bytes:
    return b"not a database"


def other_keys(content: bytes) -> Callable[[bytes], bytes]:
    return lambda _: content


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("supervisor.sqlite", journal_with_damaged_pages),
        ("supervisor.sqlite", journal_that_is_cut),
        ("supervisor.sqlite", no_journal),
        ("keys.json", other_keys(b"")),
        ("keys.json", other_keys(b"[]")),
        ("keys.json", other_keys(b'{"version": 1, "keys": [{"name": "ann"}]}')),
        ("keys.json", other_keys(b'{"version": 9, "keys": []}')),
    ],
)
def test_a_backup_of_damaged_files_is_refused_and_leaves_no_files(
    data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    damage: Callable[[bytes], bytes],
) -> None:
    with closing(open_store(data / "supervisor.sqlite")) as store:
        store.add(job("first"))
    file, after = tmp_path / "bench.tar.gz", tmp_path / "after"
    assert main(["backup", str(file), "--data", str(data)]) == 0
    with tarfile.open(file) as archive:
        contents = {
            entry.name: stream.read()
            for entry in archive
            if (stream := archive.extractfile(entry)) is not None
        }
    contents[name] = damage(contents[name])
    about = json.loads(contents["backup.json"])
    about["files"][name] = sha256(contents[name]).hexdigest()
    contents["backup.json"] = json.dumps(about).encode()
    with tarfile.open(file, "w:gz") as archive:
        for place, content in contents.items():
            entry = tarfile.TarInfo(place)
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
    assert main(["restore", str(file), "--data", str(after)]) == 1
    error = capsys.readouterr().err
    assert name in error
    assert ".restore-" not in error
    assert not after.exists()


def test_a_folder_without_a_journal_is_not_a_data_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["backup", str(tmp_path / "b.tar.gz"), "--data", str(tmp_path)]) == 1
    assert "name the folder with --data" in capsys.readouterr().err
    with closing(sqlite3.connect(tmp_path / "supervisor.sqlite")) as base:
        base.execute("CREATE TABLE x (y)")
    assert not (tmp_path / "b.tar.gz").exists()


def crafted(data: Path, file: Path, change: Callable[[tarfile.TarFile], None]) -> None:
    """Write a valid backup, and replace it by one with additional content."""
    open_store(data / "supervisor.sqlite").close()
    assert main(["backup", str(file), "--data", str(data)]) == 0
    with tarfile.open(file) as archive:
        contents = [(entry, archive.extractfile(entry)) for entry in archive]
        contents = [(entry, io.BytesIO(stream.read())) for entry, stream in contents if stream]
    with tarfile.open(file, "w:gz", errors="surrogateescape") as archive:
        for entry, content in contents:
            archive.addfile(entry, content)
        change(archive)


def special(kind: bytes) -> Callable[[tarfile.TarFile], None]:
    def add(archive: tarfile.TarFile) -> None:
        entry = tarfile.TarInfo("models/x")
        entry.type, entry.linkname = kind, "/etc/passwd"
        archive.addfile(entry)

    return add


def twice(archive: tarfile.TarFile) -> None:
    archive.addfile(tarfile.TarInfo("keys.json"))


def bomb(archive: tarfile.TarFile) -> None:
    entry = tarfile.TarInfo("models/zeros")
    entry.size = 300 * 2**20
    archive.addfile(entry, Zeros())


def long_attribute(archive: tarfile.TarFile) -> None:
    entry = tarfile.TarInfo("models/x")
    entry.pax_headers = {"comment": "0" * (8 * 2**20)}
    archive.addfile(entry)


class Zeros(io.RawIOBase):
    def read(self, size: int = -1, /) -> bytes:
        return bytes(size)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (special(tarfile.SYMTYPE), "which does not belong in a backup"),
        (special(tarfile.LNKTYPE), "which does not belong in a backup"),
        (special(tarfile.CHRTYPE), "which does not belong in a backup"),
        (special(tarfile.FIFOTYPE), "which does not belong in a backup"),
        (special(tarfile.DIRTYPE), "which does not belong in a backup"),
        (special(tarfile.GNUTYPE_SPARSE), "cannot be restored"),
        (twice, "keys.json twice"),
        (bomb, "unpacks to more than"),
        (long_attribute, "a header of"),
    ],
)
def test_a_crafted_backup_is_refused_and_leaves_no_files(
    data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Callable[[tarfile.TarFile], None],
    words: str,
) -> None:
    file, after = tmp_path / "bench.tar.gz", tmp_path / "after"
    crafted(data, file, change)
    assert main(["restore", str(file), "--data", str(after)]) == 1
    assert words in capsys.readouterr().err
    assert not after.exists()
    after.mkdir()
    assert main(["restore", str(file), "--data", str(after)]) == 1
    assert list(after.iterdir()) == []


@pytest.mark.parametrize("part", [0.0, 0.001, 0.5, 0.99])
def test_a_truncated_backup_is_refused_and_leaves_no_files(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], part: float
) -> None:
    file, after = tmp_path / "bench.tar.gz", tmp_path / "after"
    crafted(data, file, lambda _: None)
    content = file.read_bytes()
    file.write_bytes(content[: int(part * len(content))])
    assert main(["restore", str(file), "--data", str(after)]) == 1
    assert "cannot be restored, and nothing was written" in capsys.readouterr().err
    assert not after.exists()


def test_a_full_disk_leaves_no_partial_backup(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, after = tmp_path / "bench.tar.gz", tmp_path / "after"
    crafted(data, file, lambda _: None)

    def full(_number: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert main(["restore", str(file), "--data", str(after)]) == 1
    assert not after.exists()
