"""Which thread handles received items, and that no item is lost or handled twice."""

import random
import threading
from collections.abc import Callable, Iterator

import pytest

from pincette.bus.memory import MemoryBus
from pincette.config import read_rig
from pincette.core.messages import Position
from pincette.core.messages.arms import ArmPosition
from pincette.engine.loop import Item, Loop
from pincette.engine.runner import Runner
from pincette_estimator import SERVICE
from tests.support.rigs import DEMO

SOON_S = 10.0
"""Time longer than a stall of the machine, in s."""
LONG_S = 1000.0


def item(number: int) -> Item:
    return Position(0, number, 0.0, (ArmPosition(1.0, valid=True),)), 0.0, "", None


class Program(Loop):
    """A loop that runs in a separate thread, and records which thread handled which item."""

    def __init__(self) -> None:
        super().__init__([Runner(SERVICE, read_rig(DEMO))], MemoryBus())
        self.taken: list[tuple[int, int]] = []
        """Thread and item."""
        self.turns = 0
        self.idle_s: float = LONG_S
        self.during: Callable[[int], None] | None = None
        """Called for each item that is handled."""
        self.turned = threading.Condition()
        self.raised: list[Exception] = []
        self.thread = threading.Thread(target=self._run)

    def run_once(self) -> float:
        self.drain()
        with self.turned:
            self.turns += 1
            self.turned.notify_all()
        return self.idle_s

    def _take(self, item: Item) -> float:
        message, _, _, _ = item
        assert isinstance(message, Position)
        self.taken.append((threading.get_ident(), message.seq))
        if self.during is not None:
            self.during(message.seq)
        return 0.0

    def _run(self) -> None:
        try:
            self.run()
        except ArithmeticError as error:
            self.raised.append(error)

    def start(self) -> None:
        self.thread.start()
        self.after(1)

    def after(self, turns: int) -> None:
        """Wait until this many turns have been made."""
        with self.turned:
            assert self.turned.wait_for(lambda: self.turns >= turns, SOON_S)

    def until(self, items: int) -> None:
        """Wait until this many items have been handled."""
        with self.turned:
            assert self.turned.wait_for(lambda: len(self.taken) >= items, SOON_S)

    def end(self) -> None:
        self.stop()
        self.thread.join(SOON_S)
        assert not self.thread.is_alive()


@pytest.fixture
def program() -> Iterator[Program]:
    made = Program()
    yield made
    if made.thread.is_alive():
        made.end()


def waiting(program: Program) -> None:
    """Let the program's thread wait, so that another one can make a turn."""
    with program._running:  # pyright: ignore[reportPrivateUsage]
        pass


def test_work_submitted_before_the_start_waits(program: Program) -> None:
    program.submit(item(1))
    assert program.turns == 0
    program.start()
    assert program.taken == [(program.thread.ident, 1)]


def test_the_submitting_thread_runs_the_work_itself(program: Program) -> None:
    program.start()
    waiting(program)
    program.submit(item(1))
    assert program.taken == [(threading.get_ident(), 1)]


def test_deferred_work_is_run_by_the_program(program: Program) -> None:
    program.start()
    waiting(program)
    program.defer(item(1))
    program.defer(item(2))
    program.until(2)
    assert program.taken == [(program.thread.ident, 1), (program.thread.ident, 2)]


def test_the_thread_that_runs_the_loop_also_runs_newly_submitted_work(program: Program) -> None:
    def submit_more(number: int) -> None:
        if number < 3:
            other = threading.Thread(target=program.submit, args=(item(number + 1),))
            other.start()
            other.join(SOON_S)
            assert not other.is_alive(), "submitting must not wait for a turn"

    program.start()
    waiting(program)
    program.during = submit_more
    program.submit(item(1))
    assert program.taken == [(threading.get_ident(), number) for number in (1, 2, 3)]


def test_a_timer_set_by_another_thread_wakes_the_program(program: Program) -> None:
    program.start()
    waiting(program)
    program.idle_s = 0.001
    program.submit(item(1))
    program.after(4)
    assert program.taken == [(threading.get_ident(), 1)], (
        "the program's own thread must have run only the timer"
    )


def test_a_failure_in_any_thread_ends_the_program(program: Program) -> None:
    def fail(_number: int) -> None:
        raise ZeroDivisionError

    program.start()
    waiting(program)
    program.during = fail
    program.submit(item(1))
    program.thread.join(SOON_S)
    program.submit(item(2))
    assert [type(error) for error in program.raised] == [ZeroDivisionError]
    assert [number for _, number in program.taken] == [1], "no more turns may run after the failure"


def test_a_stop_ends_even_a_long_wait(program: Program) -> None:
    program.start()
    program.end()
    assert program.raised == []


def test_each_item_is_run_once_and_by_one_thread_at_a_time(program: Program) -> None:
    seed, count, threads = 23, 2000, 4
    print(f"seed {seed}")
    at_it = threading.Lock()

    def alone(number: int) -> None:
        assert at_it.acquire(blocking=False)
        if number % 7 == 0:
            threading.Event().wait(1e-5)  # another thread gets its turn
        at_it.release()

    def submit(first: int) -> None:
        chance = random.Random(seed + first)
        for number in range(count):
            act = program.defer if chance.random() < 0.2 else program.submit
            act(item(first * count + number))

    program.during = alone
    program.start()
    submitting = [threading.Thread(target=submit, args=(first,)) for first in range(threads)]
    for thread in submitting:
        thread.start()
    for thread in submitting:
        thread.join(SOON_S)
    program.until(threads * count)
    taken = [number for _, number in program.taken]
    assert sorted(taken) == list(range(threads * count))
    for first in range(threads):
        own = [number for number in taken if number // count == first]
        assert own == sorted(own), "the items must run in their order of arrival"
    assert len({thread for thread, _ in program.taken}) > 1
