"""The collector runs between the turns of a loop, and there alone."""

import gc
import sys
import weakref
from collections.abc import Generator

import pytest

from pincette.runtime.interpreter import SWITCH_S, TURNS, Collector, settle


class Cycle:
    """Something that only the collector frees."""

    def __init__(self) -> None:
        self.own = self


@pytest.fixture
def settled() -> Generator[None]:
    interval_s = sys.getswitchinterval()
    settle()
    yield
    gc.unfreeze()
    gc.enable()
    sys.setswitchinterval(interval_s)


@pytest.mark.usefixtures("settled")
def test_nothing_is_collected_within_a_turn() -> None:
    assert not gc.isenabled()
    assert gc.get_freeze_count() > 0
    assert sys.getswitchinterval() == pytest.approx(SWITCH_S)


@pytest.mark.usefixtures("settled")
def test_cycles_are_freed_after_so_many_turns() -> None:
    left = weakref.ref(Cycle())
    collector = Collector()
    for _ in range(TURNS - 1):
        collector.turned()
    assert left() is not None
    collector.turned()
    assert left() is None
