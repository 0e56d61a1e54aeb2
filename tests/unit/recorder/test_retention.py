"""Which records are deleted."""

import os
from pathlib import Path

from pincette_recorder import retention
from pincette_recorder.retention import Kept, doomed

NOW_S = 1_000_000.0


def _kept(count: int, size: int = 100) -> list[Kept]:
    """Records that ended one second after the other, the first the oldest."""
    return [Kept(f"j-{place:02d}", NOW_S - 1000.0 + place, size) for place in range(count)]


def test_nothing_is_deleted_where_nothing_is_asked() -> None:
    assert doomed(_kept(50), NOW_S, None, None) == []


def test_the_old_are_deleted() -> None:
    assert doomed(_kept(20), NOW_S, 997.0, None) == ["j-00", "j-01", "j-02"]


def test_the_newest_ten_stay_whatever_their_age() -> None:
    assert doomed(_kept(12), NOW_S, 1.0, None) == ["j-00", "j-01"]
    assert doomed(_kept(10), NOW_S, 1.0, 1) == []


def test_the_oldest_are_deleted_until_the_rest_fits() -> None:
    assert doomed(_kept(20), NOW_S, None, 1750) == ["j-00", "j-01", "j-02"]


def test_a_folder_is_deleted_and_others_stay(tmp_path: Path) -> None:
    for place in range(13):
        folder = tmp_path / f"j-{place:02d}"
        folder.mkdir()
        (folder / "samples.parquet").write_bytes(b"x" * 1000)
        manifest = folder / "manifest.json"
        manifest.write_text("{}", encoding="utf-8")
        os.utime(manifest, (NOW_S + place, NOW_S + place))
    (tmp_path / "open").mkdir()
    (tmp_path / "open" / "job.mcap").write_bytes(b"")
    kept = retention.ended(tmp_path)
    assert len(kept) == 13
    assert kept[0].size == 1002
    for name in doomed(kept, NOW_S + 1e6, 10.0, None):
        retention.delete(tmp_path, name)
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == [*(f"j-{place:02d}" for place in range(3, 13)), "open"]


def test_a_deletion_that_broke_off_is_ended(tmp_path: Path) -> None:
    grave = tmp_path / ".deleted-j-01"
    grave.mkdir()
    (grave / "manifest.json").write_text("{}", encoding="utf-8")
    assert retention.ended(tmp_path) == []
    retention.sweep(tmp_path)
    assert list(tmp_path.iterdir()) == []
