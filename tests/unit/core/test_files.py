"""A replaced file and a new folder survive a power cut; no file is partly written."""

import os
import stat
from pathlib import Path

import pytest

from pincette.core.files import make_folder, publish, replace_file, replacing
from tests.support.durable import Durable


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Durable:
    return Durable(monkeypatch)


def test_a_replaced_file_outlasts_a_power_cut(disk: Durable, tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    replace_file(root / "keys", b"old")
    replace_file(root / "keys", b"new")
    left = disk.cut(root, tmp_path / "left")
    assert {path.name: path.read_bytes() for path in left.iterdir()} == {"keys": b"new"}


def test_an_ordinary_write_does_not_survive_a_power_cut(disk: Durable, tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    (root / "plain").write_bytes(b"lost")
    assert list(disk.cut(root, tmp_path / "left").iterdir()) == []


def test_an_interrupted_replacement_leaves_the_old_file(disk: Durable, tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    replace_file(root / "keys", b"old")
    with replacing(root / "keys") as draft:
        draft.write_bytes(b"new")
        left = disk.cut(root, tmp_path / "left")
    assert (left / "keys").read_bytes() == b"old"
    assert (root / "keys").read_bytes() == b"new"


def test_an_error_leaves_the_old_file_and_no_draft(tmp_path: Path) -> None:
    path = tmp_path / "keys"
    path.write_bytes(b"old")

    def write_half() -> None:
        with replacing(path) as draft:
            draft.write_bytes(b"half")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_half()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_temporary_file_has_its_permissions_from_the_first_byte_on(tmp_path: Path) -> None:
    mask = os.umask(0o022)
    try:
        with replacing(tmp_path / "keys", 0o600) as draft:
            assert stat.S_IMODE(draft.stat().st_mode) == 0o600
    finally:
        os.umask(mask)
    assert stat.S_IMODE((tmp_path / "keys").stat().st_mode) == 0o600


def test_a_large_temporary_file_is_synced_and_renamed(disk: Durable, tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    draft = root / "table.part"
    draft.write_bytes(b"rows")
    publish(draft, root / "table")
    left = disk.cut(root, tmp_path / "left")
    assert {path.name: path.read_bytes() for path in left.iterdir()} == {"table": b"rows"}


def test_folders_outlast_a_power_cut(disk: Durable, tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    make_folder(root / "data" / "jobs" / "j-1")
    make_folder(root / "data" / "jobs" / "j-1")
    assert (disk.cut(root, tmp_path / "left") / "data" / "jobs" / "j-1").is_dir()


def test_a_file_instead_of_a_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "data").write_bytes(b"")
    with pytest.raises(OSError, match="data"):
        make_folder(tmp_path / "data" / "jobs")
