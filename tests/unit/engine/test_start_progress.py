"""A start is abandoned if it makes no progress, however long it takes otherwise; logs are kept."""

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.engine import fleet as fleet_module
from pincette.engine import log_files
from pincette.engine.fleet import Fleet, FleetError
from pincette.engine.start_progress import (
    LEAST_S,
    LONGEST_S,
    NEWS_S,
    STALLED_S,
    StartProgress,
    demand_s,
)
from tests.support.rigs import demo_rig

MOST_LENGTH = 80 - len("● supervisor 4194304 ")
"""Length that fits on a line of a terminal, after a program's name and number."""


class Machine:
    """Virtual time, processor time and log length of one program."""

    def __init__(self) -> None:
        self.now_s = self.used_s = 0.0
        self.logged = 0
        self.progress = StartProgress(lambda: self.used_s, lambda: self.logged, lambda: self.now_s)


def test_a_slow_start_is_waited_for_and_reported() -> None:
    machine, news = Machine(), list[str]()
    while machine.now_s < 600.0:
        machine.now_s += 1.0
        machine.used_s += 0.05  # a twentieth of a processor
        assert machine.progress.why_given_up() == ""
        if stated := machine.progress.news():
            news.append(stated)
    assert len(news) == 600.0 / NEWS_S
    assert max(map(len, news)) <= MOST_LENGTH


def test_a_program_that_logs_makes_progress() -> None:
    machine = Machine()
    while machine.now_s < 600.0:
        machine.now_s += STALLED_S / 2.0
        machine.logged += 1
        assert machine.progress.why_given_up() == ""


def test_a_stalled_start_is_given_up() -> None:
    machine = Machine()
    while machine.now_s < STALLED_S:
        machine.now_s += 1.0
        machine.used_s += 0.5 * LEAST_S / STALLED_S  # it polls
        assert machine.progress.why_given_up() == ""
    machine.now_s += 1.0
    assert "no progress" in machine.progress.why_given_up()


def test_an_endless_start_is_given_up() -> None:
    machine = Machine()
    machine.now_s = machine.used_s = LONGEST_S + 1.0
    assert "not ready" in machine.progress.why_given_up()


def test_processor_time_includes_children_but_not_sleep() -> None:
    code = (
        "import subprocess, sys, time;"
        "subprocess.run([sys.executable, '-c', 'while True: pass']) if sys.argv[1] == 'busy'"
        " else time.sleep(60)"
    )
    busy, idle = (
        subprocess.Popen([sys.executable, "-c", code, kind], start_new_session=True)
        for kind in ("busy", "idle")
    )
    try:
        deadline = monotonic() + 20.0
        while demand_s(busy.pid) < 0.5:
            assert monotonic() < deadline
            sleep(0.05)
        before_s = demand_s(idle.pid)
        sleep(0.3)
        assert demand_s(idle.pid) - before_s < 0.05
    finally:
        for process in (busy, idle):
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.fixture
def fleet(tmp_path: Path) -> Fleet:
    return Fleet(demo_rig(), tmp_path / "none.toml", tmp_path / "data", lambda _name, _line: None)


def test_a_program_that_dies_at_the_start_is_named_with_status_and_reason(fleet: Fleet) -> None:
    with pytest.raises(FleetError, match=r"sensor did not start \(exit status 2\):\n.*none\.toml"):
        fleet.start(["sensor"])
    fleet.down()


def test_a_stalled_start_names_the_program(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet_module, "LOOK_S", 0.0)

    def stalled(_progress: StartProgress) -> str:
        return "has made no progress"

    monkeypatch.setattr(StartProgress, "why_given_up", stalled)
    with pytest.raises(FleetError, match="sensor has made no progress"):
        fleet.start(["sensor"])
    fleet.down()


def test_logs_of_earlier_starts_are_kept_for_this_account_only(
    fleet: Fleet, tmp_path: Path
) -> None:
    for _ in range(2):
        with pytest.raises(FleetError):
            fleet.start(["sensor"])
        fleet.down()
        fleet.members.clear()
    log = tmp_path / "data" / "logs" / "sensor.log"
    assert log.read_text(encoding="utf-8").count("none.toml") == 2
    assert stat.S_IMODE(log.stat().st_mode) == 0o600
    assert stat.S_IMODE(log.parent.stat().st_mode) == 0o700


def test_logs_are_rotated_with_a_bound_while_a_program_writes(tmp_path: Path) -> None:
    log = tmp_path / "sensor.log"
    with log_files.open_to_append(log) as stream:
        for number in range(10):
            stream.write(f"{number}" * 100 + "\n")
            stream.flush()
            log_files.rotate_if_full(log, 100)
        stream.write("last\n")
    assert log.read_text(encoding="utf-8") == "last\n"
    older = sorted(path.name for path in tmp_path.iterdir() if path != log)
    assert older == [f"sensor.log.{number}" for number in range(1, log_files.KEPT + 1)]
    assert log.with_name("sensor.log.1").read_text(encoding="utf-8").startswith("9")
    assert {stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()} == {0o600}


def test_a_removed_log_folder_is_created_again(tmp_path: Path) -> None:
    log = tmp_path / "logs" / "supervisor.log"
    with log_files.open_to_append(log) as stream:
        stream.write("first\n")
    log.unlink()
    log.parent.rmdir()
    log_files.open_to_append(log).close()
    assert log.stat().st_mode & 0o077 == 0
    assert log.parent.stat().st_mode & 0o077 == 0
