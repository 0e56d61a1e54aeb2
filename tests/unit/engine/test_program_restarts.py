"""A program outside the loop that dies is restarted, at once and then less often."""

import errno
import os
import subprocess
from pathlib import Path
from typing import cast

import pytest

from pincette.engine.fleet import Child, Fleet
from pincette.engine.revival import FIRST_S, LONGEST_S, WELL_S, Revival


class Process:
    """Has a process number and perhaps an exit status."""

    def __init__(self, pid: int) -> None:
        self.pid, self.returncode = pid, cast("int | None", None)


class Programs:
    """Replaces the processes of the operating system."""

    def __init__(self, *names: str) -> None:
        self.members = {name: self._child(name, 100 + n) for n, name in enumerate(names)}
        self.revived: list[str] = []
        self.error: OSError | None = None
        """Error with which starts of programs fail."""

    def _child(self, name: str, pid: int) -> Child:
        process = cast("subprocess.Popen[str]", Process(pid))
        return Child(name, process, Path(f"{name}.log"))

    def ended(self) -> list[Child]:
        return [one for one in self.members.values() if one.process.returncode is not None]

    def revive(self, name: str) -> Child:
        if self.error is not None:
            raise self.error
        self.revived.append(name)
        self.members[name] = self._child(name, 200 + len(self.revived))
        return self.members[name]


@pytest.fixture
def programs() -> Programs:
    return Programs("supervisor", "recorder", "controller", "router", "upstream")


class Watched:
    """Lets time pass, and stores the messages."""

    def __init__(self, programs: Programs) -> None:
        self.now_s, self.said = 0.0, list[str]()
        self.revival = Revival(cast(Fleet, programs), clock=lambda: self.now_s)

    def after(self, duration_s: float) -> None:
        self.now_s += duration_s
        self.revival.look(lambda member, line: self.said.append(f"{member.name}: {line}"))


def test_a_supervisor_is_restarted_and_reported_once(programs: Programs) -> None:
    watched = Watched(programs)
    programs.members["supervisor"].process.returncode = -9
    for _ in range(3):
        watched.after(0.1)
    assert programs.revived == []
    watched.after(FIRST_S)
    assert programs.revived == ["supervisor"]
    (line,) = watched.said
    assert line.startswith("supervisor: ended, status -9; see supervisor.log; restart in 0.5")
    assert "a held part stays held" in line


@pytest.mark.parametrize("name", ["recorder", "router", "upstream"])
def test_other_programs_beside_the_loop_are_restarted(programs: Programs, name: str) -> None:
    watched = Watched(programs)
    programs.members[name].process.returncode = -9
    watched.after(0.1)
    watched.after(FIRST_S)
    assert programs.revived == [name]


def test_programs_of_the_loop_are_left_to_a_person(programs: Programs) -> None:
    watched = Watched(programs)
    programs.members["controller"].process.returncode = 1
    watched.after(100.0)
    watched.after(100.0)
    assert programs.revived == []
    assert watched.said == ["controller: ended, status 1; see controller.log"]


@pytest.mark.parametrize("status", [0, 1, 2, 3, 137, -6, -15])
def test_a_program_that_was_ready_is_restarted_whatever_its_status(
    programs: Programs, status: int
) -> None:
    watched = Watched(programs)
    for attempt, wait_s in enumerate((FIRST_S, 2.0 * FIRST_S), 1):
        programs.members["supervisor"].process.returncode = status
        watched.after(0.1)
        watched.after(wait_s)
        assert programs.revived == ["supervisor"] * attempt
    assert f"status {status}" in watched.said[0]


def test_a_program_that_dies_repeatedly_is_restarted_with_growing_delay(programs: Programs) -> None:
    watched = Watched(programs)
    waits_s: list[float] = []
    for _ in range(8):
        programs.members["supervisor"].process.returncode = 1
        watched.after(0.1)
        begun_s, count = watched.now_s, len(programs.revived)
        while len(programs.revived) == count:
            watched.after(0.25)
        waits_s.append(watched.now_s - begun_s)
    assert waits_s == pytest.approx([0.5, 1.0, 2.0, 4.0, 8.0, *[LONGEST_S] * 3])
    watched.after(WELL_S)
    programs.members["supervisor"].process.returncode = 1
    watched.after(0.1)
    assert "restart in 0.5 s" in watched.said[-1]


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.ENOMEM, errno.EAGAIN, errno.ENOENT])
def test_a_restart_that_the_system_refuses_is_tried_again_and_does_not_end_other_programs(
    programs: Programs, number: int
) -> None:
    watched = Watched(programs)
    programs.members["supervisor"].process.returncode = -9
    programs.error = OSError(number, os.strerror(number))
    watched.after(0.1)
    watched.after(FIRST_S)
    watched.after(LONGEST_S - 0.1)
    assert len(watched.said) == 2
    assert os.strerror(number) in watched.said[1]
    programs.error = None
    watched.after(0.1)
    assert programs.revived == ["supervisor"]
