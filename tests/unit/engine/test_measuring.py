"""Wake-ups on a grid, in virtual time; and load that keeps a machine busy."""

import os
import subprocess
from itertools import chain, repeat
from pathlib import Path

import pytest

from pincette.engine.measuring import load
from pincette.engine.measuring.worker import SETTLED, wake_ups

T = 0.01


class Clock:
    """Time that passes while a thread waits, plus the lateness of the machine."""

    def __init__(self, *late_s: float) -> None:
        self.now_s = 100.0
        self._late_s = chain(late_s, repeat(0.0))
        self.waits = 0

    def clock_s(self) -> float:
        return self.now_s

    def wait_s(self, timeout_s: float) -> None:
        self.waits += 1
        self.now_s += timeout_s + next(self._late_s)


def measured(clock: Clock, for_s: float) -> tuple[int, float, int]:
    found = wake_ups(T, for_s, clock.clock_s, clock.wait_s)
    assert found.period_s == T
    return found.lateness.count, found.lateness.max_s, found.missed


def test_measured_wake_ups_follow_an_absolute_time_grid() -> None:
    clock = Clock(*[0.004] * 60)
    count, max_s, missed = measured(clock, 50.5 * T)
    assert (count, missed) == (50 - SETTLED, 0)
    assert max_s == pytest.approx(0.004)
    assert clock.now_s == pytest.approx(100.0 + 50 * T + 0.004)


def test_missed_grid_points_are_skipped() -> None:
    clock = Clock(*[0.0] * 19, 3.5 * T)
    count, max_s, missed = measured(clock, 50.5 * T)
    assert missed == 3
    assert count == 50 - SETTLED - 3
    assert max_s == pytest.approx(3.5 * T)


def test_the_first_wake_ups_are_not_counted() -> None:
    assert measured(Clock(0.5 * T), 50.5 * T)[1] == pytest.approx(0.0, abs=1e-9)


def test_a_wait_that_ends_early_is_continued() -> None:
    clock = Clock(*[-0.5 * T, 0.0] * 60)
    count, max_s, _ = measured(clock, 50.5 * T)
    assert count == 50 - SETTLED
    assert max_s == pytest.approx(0.0, abs=1e-9)
    assert clock.waits > 50


def test_the_artificial_load_has_a_program_per_processor_and_one_for_the_disk_and_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    started: list[subprocess.Popen[bytes]] = []

    def popen(words: list[str]) -> subprocess.Popen[bytes]:
        started.append(real_popen(words))
        return started[-1]

    real_popen = subprocess.Popen
    monkeypatch.setattr("pincette.engine.measuring.load.subprocess.Popen", popen)
    with load.load(60.0):
        assert len(started) == 1 + (os.cpu_count() or 1)
    assert all(program.poll() is not None for program in started)


def test_load_programs_end_by_themselves(tmp_path: Path) -> None:
    load.main(["0.01", "cpu"])
    load.main(["0.01", "disk", str(tmp_path / "block")])
    assert (tmp_path / "block").stat().st_size >= load.BLOCK
