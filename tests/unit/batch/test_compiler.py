"""Where machine code is kept, and what becomes of it where it cannot be."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from pincette_batch.compiling import as_record, compiled


def halved(value: float) -> float:
    return 0.5 * value


def test_what_was_compiled_is_kept_in_the_user_s_cache(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert compiled(halved)(3.0) == 1.5
    (folder,) = (tmp_path / "pincette" / "compiled").iterdir()
    kept = {path.suffix for path in folder.rglob("*") if path.is_file()}
    assert kept == {".nbi", ".nbc"}


@dataclass(frozen=True, slots=True)
class Pair:
    first: float
    second: float


def summed(pair: Pair) -> float:
    return pair.first + pair.second


def kept_as(cache: Path) -> set[str]:
    return {path.name for path in cache.rglob("*.nbc")}


def test_another_process_finds_what_takes_a_dataclass(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert compiled(summed)(as_record(Pair(1.0, 2.5))) == 3.5
    before = kept_as(tmp_path)
    here = f"from {__name__} import *"
    again = f"{here}\nassert compiled(summed)(as_record(Pair(2.0, 0.25))) == 2.25"
    subprocess.run([sys.executable, "-c", again], check=True, timeout=60.0)
    assert kept_as(tmp_path) == before


def test_without_a_place_to_keep_it_it_is_compiled_all_the_same(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    occupied = tmp_path / "a file, not a folder"
    occupied.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(occupied))
    assert compiled(halved)(5.0) == 2.5
    assert occupied.read_text() == ""
