"""A day of grips and holds in virtual time, without a fault: no trip and no refusal."""

import os
import resource
from time import perf_counter

import pytest

from pincette.core.messages import Status, StatusRequest
from tests.support.scripted import PROGRAM
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_places import T, begun

DAY_H = 24.0
REST_S = 60.0
"""Time for which the rig idles between two grips; every tenth time it rests for longer."""
LONGEST_S = 20.0
GROWTH_KB = 20_000
"""Allowed growth of the memory after the first hour; a leak per tick would be far above it."""


def test_several_grips_in_a_row_do_not_trip() -> None:
    live(begun(), 30.0)


@pytest.mark.slow
def test_a_day_runs_without_a_fault(capsys: pytest.CaptureFixture[str]) -> None:
    hours = float(os.environ.get("PINCETTE_VIRTUAL_HOURS", DAY_H))
    loop, began_s = begun(), perf_counter()
    grips = live(loop, 3600.0 * min(1.0, 0.5 * hours))
    before_kB = memory_kB()
    grips += live(loop, 3600.0 * hours - loop.now_s)
    growth_kB, took_s = memory_kB() - before_kB, perf_counter() - began_s
    with capsys.disabled():
        print(
            f"\n{loop.now_s / 3600.0:.1f} h of virtual time in {took_s:.0f} s, {grips} grips, "
            f"{loop.runner('sensor').steps} samples; memory grew by {growth_kB} kB"
        )
    assert growth_kB < GROWTH_KB


def memory_kB() -> int:
    """Return the largest memory that this process has used so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def live(loop: VirtualLoop, for_s: float) -> int:
    """Grip repeatedly; returns the number of grips."""
    until_s, grips = loop.now_s + for_s, 0
    epoch = loop.runner("actuator").state.epoch
    loop.told = None
    while True:
        assert loop.run(loop.now_s + LONGEST_S, lambda: loop.newest.state == "idle")
        grips += 1
        check(loop)
        if loop.now_s >= until_s:
            return grips
        loop.run(loop.now_s + (REST_S if grips % 10 == 0 else 5.0 * T))
        epoch += 1
        loop.arm(PROGRAM, epoch)


def check(loop: VirtualLoop) -> None:
    """Check that there was no trip, no refusal and no missed tick, and that a part was gripped."""
    states = {echo.state for _, echo in loop.applied}
    assert states <= {"latched", "idle", "armed"}, states
    view = loop.runner("controller").state.player
    assert view.outcome == "gripped", f"{view.outcome} at {loop.now_s:.0f} s"
    for name, program in loop.programs.items():
        status = loop.call(name, StatusRequest())
        assert isinstance(status, Status)
        assert (program.refused, status.missed) == (0, 0), status
        # Samples of the idle loop that are in transit while it is being armed belong to the
        # previous epoch and are rightly dropped.
        assert status.refused <= 4 * loop.runner("actuator").state.epoch, status
    loop.applied = loop.applied[-1:]
    loop.put_out = loop.put_out[-1:]
