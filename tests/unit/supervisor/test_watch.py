"""Time in which the supervisor itself was stalled does not count towards a deadline."""

from types import SimpleNamespace
from typing import cast

import pytest

from pincette_supervisor.jobs.job import JobStatus, LiveJob
from pincette_supervisor.jobs.job_monitor import STANDSTILL_S, Watch
from pincette_supervisor.jobs.tracker import Tracker
from pincette_supervisor.plugin import Planned

RESUMING_S = 5.0


class Clock:
    def __init__(self) -> None:
        self.now_s = 10.0

    def __call__(self) -> float:
        return self.now_s


def watched(clock: Clock, *, lockstep: bool = False) -> Watch:
    status = JobStatus(id="a", state="resuming", revision=1, moves=3, entered_at=clock())
    job = SimpleNamespace(status=status, request=SimpleNamespace(kind="grip"))
    rig = SimpleNamespace(lockstep=lockstep)
    planned = SimpleNamespace(model=SimpleNamespace(rig=rig))
    tracker = SimpleNamespace(played_s=0.0)
    return Watch(cast(LiveJob, job), cast(Planned, planned), cast(Tracker, tracker), clock, clock)


@pytest.mark.parametrize("stood_s", [6.0, 600.0])
def test_a_stall_does_not_count_as_job_time(stood_s: float) -> None:
    clock = Clock()
    watch = watched(clock)
    watch.look()
    clock.now_s += stood_s
    watch.look()
    assert not watch.overdue()
    for _ in range(round(RESUMING_S / STANDSTILL_S)):
        clock.now_s += STANDSTILL_S
        watch.look()
    assert watch.overdue()


def test_frequent_checks_do_not_delay_the_deadline() -> None:
    clock = Clock()
    watch = watched(clock)
    while not watch.overdue():
        clock.now_s += 0.02
        watch.look()
    assert clock.now_s - 10.0 == pytest.approx(RESUMING_S, abs=0.05)
