"""How the previous actuator ended, from a file that may be missing, damaged or not writable."""

import os
from pathlib import Path

import pytest

from pincette.core.faults import Predecessor
from pincette.engine import boot_note as module
from pincette.engine.boot_note import FIRST, Before, BootNote


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "data" / "actuator-demo.json"


def test_a_missing_boot_note_means_a_first_start(path: Path) -> None:
    assert BootNote(path).found() == FIRST


def test_a_boot_note_without_an_end_means_that_the_program_has_died(path: Path) -> None:
    BootNote(path).begin()
    assert BootNote(path).found() == Before(Predecessor.DIED)
    BootNote(path).end(Predecessor.DIED, 7)
    assert BootNote(path).found() == Before(Predecessor.DIED)


@pytest.mark.parametrize("ending", [Predecessor.CLEAN, Predecessor.NONE])
def test_the_stored_end_of_a_program_is_read_back(path: Path, ending: Predecessor) -> None:
    note = BootNote(path)
    note.begin()
    note.end(ending, 7)
    assert BootNote(path).found() == Before(ending, 7)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b'{"ended": "well"}',
        b'{"end": 1}',
        b"\xff",
        b'{"ended": "clean", "instance": 18446744073709551616}',
        b'{"ended": "clean", "instance": "7"}',
    ],
)
def test_a_damaged_note_is_not_a_clean_end(path: Path, content: bytes) -> None:
    path.parent.mkdir()
    path.write_bytes(content)
    assert BootNote(path).found() == Before(Predecessor.DIED)


def test_a_note_that_cannot_be_replaced_is_not_a_clean_end(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    note = BootNote(path)
    note.begin()
    note.end(Predecessor.CLEAN, 7)

    def full(_number: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert BootNote(path).found() == Before(Predecessor.DIED)
    BootNote(path).begin()
    assert BootNote(path).found() == Before(Predecessor.DIED)
    assert [one.name for one in path.parent.iterdir()] == [path.name]


def test_a_full_disk_at_the_first_start_leaves_no_clean_end(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    assert BootNote(path).found() == FIRST
    with monkeypatch.context() as patched:
        patched.setattr(module, "replace_file", full)
        BootNote(path).begin()
    assert BootNote(path).found() == Before(Predecessor.DIED)


def test_a_program_that_cannot_write_its_note_does_not_start(path: Path) -> None:
    path.parent.write_text("a file where the folder belongs")
    with pytest.raises(OSError, match=r"actuator-demo\.json cannot be written .*--data"):
        BootNote(path).begin()
