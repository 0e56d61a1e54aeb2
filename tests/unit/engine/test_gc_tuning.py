"""Garbage collection runs only between the turns of a loop; threads use a short switch interval."""

import gc
import subprocess
import sys
import weakref
from collections.abc import Generator
from pathlib import Path

import pytest

from pincette.engine.realtime.gc_tuning import COLLECT_EVERY, SWITCH_S, Collector, disable_gc

DEMO = Path(__file__).parents[3] / "deploy/rigs/demo.toml"
A_PROGRAM = f"""\
import gc, sys
from pathlib import Path
from pincette.core import plugins
from pincette.engine.process import Options, run_program

def program(context):
    context.ready("here")
    print(sys.getswitchinterval(), gc.get_freeze_count() > 0, gc.isenabled())

plugins.load = lambda group, name: program
run_program("supervisor", Path({str(DEMO)!r}), Options())
"""


class Cycle:
    """An object that only the garbage collector frees."""

    def __init__(self) -> None:
        self.own = self


@pytest.fixture
def settled() -> Generator[None]:
    interval_s = sys.getswitchinterval()
    disable_gc()
    yield
    gc.unfreeze()
    gc.enable()
    sys.setswitchinterval(interval_s)


@pytest.mark.usefixtures("settled")
def test_garbage_is_not_collected_while_the_loop_runs() -> None:
    assert not gc.isenabled()
    assert gc.get_freeze_count() > 0
    assert sys.getswitchinterval() == pytest.approx(SWITCH_S)


@pytest.mark.usefixtures("settled")
def test_cycles_are_freed_after_a_number_of_turns() -> None:
    left = weakref.ref(Cycle())
    collector = Collector()
    for _ in range(COLLECT_EVERY - 1):
        collector.collect_if_due()
    assert left() is not None
    collector.collect_if_due()
    assert left() is None


def test_every_program_outside_the_loop_tunes_its_garbage_collector_before_it_serves() -> None:
    output = subprocess.check_output([sys.executable, "-c", A_PROGRAM], text=True, timeout=60.0)
    assert output.splitlines() == ["ready: here", f"{SWITCH_S} True True"]
