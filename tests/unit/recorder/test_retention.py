"""Which records are deleted: by the time that recorders have counted, independently of the
clock."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from pincette.records import folder as files
from pincette_recorder import counted_time, retention
from pincette_recorder.counted_time import STATE, CountedTime
from pincette_recorder.repairer import RecordRepairer
from pincette_recorder.retention import Kept, records_to_delete

from .conftest import CONFIG

DAY_S = 86_400.0
START_S = 1_790_000_000.0
"""Time of day at the start of a test, in s since 1970 (UTC)."""


def _kept(count: int, size: int = 100) -> list[Kept]:
    return [Kept(f"j-{place:02d}", size) for place in range(count)]


def _ages(count: int) -> dict[str, float]:
    """Make records that ended one second after the other, the first 1000 s ago."""
    return {f"j-{place:02d}": 1000.0 - place for place in range(count)}


def test_by_default_nothing_is_deleted() -> None:
    assert records_to_delete(_kept(50), _ages(50), None, None) == []


def test_old_records_are_deleted() -> None:
    assert records_to_delete(_kept(20), _ages(20), 997.0, None) == ["j-00", "j-01", "j-02"]


def test_the_newest_ten_are_kept_whatever_their_age() -> None:
    assert records_to_delete(_kept(12), _ages(12), 1.0, None) == ["j-00", "j-01"]
    assert records_to_delete(_kept(10), _ages(10), 1.0, 1) == []


def test_the_oldest_records_are_deleted_until_the_others_fit() -> None:
    assert records_to_delete(_kept(20), _ages(20), None, 1750) == ["j-00", "j-01", "j-02"]


def test_a_folder_is_deleted_and_others_are_kept(tmp_path: Path) -> None:
    _closed(tmp_path, 13)
    (tmp_path / "open").mkdir()
    (tmp_path / "open" / "job.mcap").write_bytes(b"")
    kept = retention.ended(tmp_path)
    assert len(kept) == 13
    assert kept[0].size == 1002
    for name in records_to_delete(kept, _ages(13), 10.0, None):
        retention.delete(tmp_path, name)
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == [*(f"j-{place:02d}" for place in range(3, 13)), "open"]


def test_an_interrupted_deletion_is_completed(tmp_path: Path) -> None:
    grave = tmp_path / ".deleted-j-01"
    grave.mkdir()
    (grave / "manifest.json").write_text("{}", encoding="utf-8")
    assert retention.ended(tmp_path) == []
    retention.sweep(tmp_path)
    assert list(tmp_path.iterdir()) == []


def _closed(records: Path, count: int, first: int = 0, at_s: float = START_S) -> None:
    for place in range(first, first + count):
        folder = records / f"j-{place:02d}"
        folder.mkdir()
        (folder / "samples.parquet").write_bytes(b"x" * 1000)
        manifest = folder / "manifest.json"
        manifest.write_text("{}", encoding="utf-8")
        os.utime(manifest, (at_s + place, at_s + place))


class Machine:
    """A machine with a recorder, a time of day that can be set, and a monotonic clock."""

    def __init__(self, records: Path, keep_days: float | None = 90.0) -> None:
        self.records = records
        self.wall_s, self.steady_s = START_S, 100.0
        keep_s = None if keep_days is None else keep_days * DAY_S
        self.config = replace(CONFIG, records=records, keep_s=keep_s)
        self.boot()

    def boot(self, off_s: float = 0.0, *, saved: bool = True) -> None:
        """Start the recorder, after the machine was off for a time."""
        if saved and hasattr(self, "repairer"):
            self.repairer.close()
        self.wall_s += off_s
        self.steady_s = 5.0
        counted = CountedTime(self.records, lambda: self.wall_s, lambda: self.steady_s)
        self.repairer = RecordRepairer(self.config, counted)
        self.tidy()

    def run(self, days: float) -> None:
        """Let time pass with the recorder running."""
        left_s = days * DAY_S
        while left_s > 0.0:
            passed_s = min(left_s, counted_time.LONGEST_S)
            left_s -= passed_s
            self.wall_s += passed_s
            self.steady_s += passed_s
            self.repairer.counted.count()
        self.tidy()

    def tidy(self) -> None:
        self.repairer.tidy_now(())

    def left(self) -> int:
        return len(list(self.records.glob("j-*")))

    @property
    def stepped(self) -> bool:
        return self.repairer.counted.step_s is not None


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Count and write in steps of a day, so that months pass quickly."""
    monkeypatch.setattr(counted_time, "LONGEST_S", DAY_S)
    monkeypatch.setattr(counted_time, "SAVE_S", DAY_S)


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    _closed(tmp_path, 15)
    return Machine(tmp_path)


def test_records_age_by_the_time_that_the_recorder_runs(machine: Machine) -> None:
    for _ in range(3):
        machine.run(29.9)
        machine.boot(off_s=6 * DAY_S)
    assert (machine.left(), machine.stepped) == (15, False)
    machine.run(0.4)
    assert machine.left() == 10


def _step(machine: Machine, step_s: float) -> None:
    machine.wall_s += step_s
    machine.run(0.01)


def _step_at_boot(machine: Machine, step_s: float) -> None:
    machine.boot(off_s=step_s)


def _step_after_a_crash(machine: Machine, step_s: float) -> None:
    machine.boot(off_s=step_s, saved=False)


TO_1970 = -START_S


@pytest.mark.parametrize("step", [_step, _step_at_boot, _step_after_a_crash])
@pytest.mark.parametrize("step_s", [200 * DAY_S, -200 * DAY_S, TO_1970, 3650 * DAY_S, -2 * DAY_S])
def test_after_a_clock_step_nothing_is_deleted_until_a_person_confirms(
    machine: Machine, step: Callable[[Machine, float], None], step_s: float
) -> None:
    machine.run(89.0)
    step(machine, step_s)
    assert machine.repairer.counted.step_s == pytest.approx(step_s, abs=DAY_S)
    machine.run(10.0)  # by now they are old
    machine.boot()
    assert (machine.left(), machine.stepped) == (15, True)
    files.agree_to_clock(machine.records)
    machine.run(0.01)
    assert (machine.left(), machine.stepped) == (10, False)
    assert not (machine.records / files.CLOCK_AGREED).exists()


def test_after_the_clock_was_corrected_no_person_has_to_confirm(machine: Machine) -> None:
    machine.run(89.0)
    machine.boot(off_s=TO_1970)  # a board without a battery
    machine.run(0.1)
    assert machine.stepped
    machine.wall_s += START_S + DAY_S  # it has received the time from its network
    machine.run(0.1)
    assert (machine.stepped, machine.left()) == (False, 15)
    machine.run(2.0)
    assert machine.left() == 10


def test_acknowledging_a_clock_step_does_not_acknowledge_the_next_one(machine: Machine) -> None:
    files.agree_to_clock(machine.records)
    _step(machine, 200 * DAY_S)
    assert machine.stepped


@pytest.mark.parametrize("content", [b"", b"{", b'{"counted_s": -1}', b'{"counted_s": 1e999}'])
def test_a_damaged_counter_of_running_time_does_not_delete_records_early(
    machine: Machine, content: bytes
) -> None:
    machine.run(89.0)
    machine.repairer.close()
    (machine.records / STATE).write_bytes(content)
    machine.boot(saved=False)
    machine.run(10.0)
    assert machine.left() == 15


def test_the_size_limit_deletes_records_in_the_order_in_which_they_were_closed(
    tmp_path: Path,
) -> None:
    _closed(tmp_path, 12)
    machine = Machine(tmp_path, keep_days=None)
    machine.run(0.01)
    machine.config = replace(machine.config, keep_bytes=11_500)
    # Made while the clock was a year behind: the newest, whatever their files say.
    _closed(tmp_path, 1, first=12, at_s=START_S - 365 * DAY_S)
    machine.boot()
    assert {path.name for path in tmp_path.glob("j-*")} == {f"j-{n:02d}" for n in range(2, 13)}


def test_the_count_is_stored_as_json(machine: Machine) -> None:
    machine.run(1.0)
    machine.repairer.close()
    tree = json.loads((machine.records / STATE).read_bytes())
    assert tree["counted_s"] == pytest.approx(DAY_S, rel=1e-6)
    assert list(tree["ended"]) == [f"j-{place:02d}" for place in range(15)]
