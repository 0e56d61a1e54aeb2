"""Row 13: of samples that come twice, late or in another order, only those in order are used."""

import random
from collections.abc import Sequence
from functools import cache
from typing import cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pincette.core.messages import (
    Applied,
    Arm,
    Command,
    Estimate,
    Load,
    Message,
    Position,
    Reset,
    Sample,
    Telemetry,
)
from pincette.engine.runner import Runner
from pincette_actuator import SERVICE as ACTUATOR
from pincette_controller import SERVICE as CONTROLLER
from pincette_estimator import SERVICE as ESTIMATOR
from tests.support.scripted import PROGRAM
from tests.support.virtual_loop_faults import LinkFault
from tests.support.virtual_loop_places import EPOCH, T, begun, near_rig, place

RIG = near_rig()
SAMPLES = 60
Orders = st.lists(st.tuples(st.integers(0, SAMPLES - 1), st.integers(-3, 3)), max_size=30)


class Tape:
    """An output that stores its commands."""

    def __init__(self) -> None:
        self.put_V: list[float] = []

    def write_V(self, voltage_V: float) -> None:
        self.put_V.append(voltage_V)

    def read_V(self) -> float:
        return 0.0

    def close(self) -> None:
        """Do nothing: there is no port to close."""


@cache
def recorded() -> dict[type[Message], list[Sample]]:
    """Messages of a loop in an approach, by topic and in order."""
    loop = begun()
    loop.run(loop.now_s + 1.5 * SAMPLES * T)
    kinds: dict[type[Message], list[Sample]] = {}
    for _, message in loop.told or []:
        if isinstance(message, Position | Estimate | Command | Applied):
            kinds.setdefault(type(message), []).append(message)
    return kinds


def shuffled(orders: Sequence[tuple[int, int]]) -> list[int]:
    """Return the numbers 0 to SAMPLES, some repeated, and some earlier or later than they are
    due."""
    seqs = list(range(SAMPLES))
    for seq, by in orders:
        seqs.insert(max(0, min(len(seqs), seq + by)), seq)
    return seqs


def in_order(seqs: Sequence[int]) -> list[int]:
    """Return the elements that are in order."""
    kept: list[int] = []
    for seq in seqs:
        if not kept or seq > kept[-1]:
            kept.append(seq)
    return kept


def turns_of(service: str, output: Tape | None = None) -> Runner:
    known = {"estimator": ESTIMATOR, "controller": CONTROLLER, "actuator": ACTUATOR}[service]
    runner = Runner(known, RIG, output, 1)
    runner.begin(0.0)
    questions: dict[str, list[Message]] = {
        "controller": [Load(PROGRAM)],
        "actuator": [Reset(acknowledge=True)],
    }
    owner = cast(Command, recorded()[Command][0]).owner
    runner.instance = owner
    for question in (*questions.get(service, []), Arm(EPOCH, owner, RIG.digest())):
        reply, _ = runner.call(question, 0.0)
        assert not isinstance(reply, str), reply
    return runner


def stepped(runner: Runner, samples: Sequence[Sample], now: float) -> list[Message]:
    for sample in samples:
        runner.take(sample, now)
    received: list[Message] = []
    for at_s in (now, now + T):
        while (outputs := runner.fire(at_s)) is not None:
            received += outputs
    return received


def by_seq(kind: type[Message], seq: int) -> list[Sample]:
    return [sample for sample in recorded()[kind] if sample.seq == seq][-1:]


def estimates(seqs: Sequence[int]) -> list[Message]:
    runner = turns_of("estimator")
    received: list[Message] = []
    for seq in seqs:
        received += stepped(runner, [*by_seq(Applied, seq - 1), *by_seq(Position, seq)], 1.0)
    return received


def commands(seqs: Sequence[int]) -> list[Message]:
    runner = turns_of("controller")
    received: list[Message] = []
    for seq in seqs:
        received += stepped(runner, by_seq(Estimate, seq), 1.0)
    return [message for message in received if isinstance(message, Command | Telemetry)]


def voltages(seqs: Sequence[int]) -> list[float]:
    tape = Tape()
    runner = turns_of("actuator", tape)
    newest, now = -1, 0.0
    for seq in seqs:
        now += T * (seq > newest)
        newest = max(seq, newest)
        stepped(runner, [*by_seq(Position, seq), *by_seq(Command, seq)], now)
    return tape.put_V


@settings(max_examples=15, deadline=None, derandomize=True)
@given(Orders)
def test_the_estimator_ignores_messages_that_arrive_out_of_order(
    orders: list[tuple[int, int]],
) -> None:
    seqs = shuffled(orders)
    assert estimates(seqs) == estimates(in_order(seqs))


@settings(max_examples=15, deadline=None, derandomize=True)
@given(Orders)
def test_the_controller_ignores_messages_that_arrive_out_of_order(
    orders: list[tuple[int, int]],
) -> None:
    seqs = shuffled(orders)
    assert commands(seqs) == commands(in_order(seqs))


@settings(max_examples=15, deadline=None, derandomize=True)
@given(Orders)
def test_the_actuator_ignores_messages_that_arrive_out_of_order(
    orders: list[tuple[int, int]],
) -> None:
    seqs = shuffled(orders)
    assert voltages(seqs) == voltages(in_order(seqs))


@pytest.mark.parametrize("seed", range(2))
def test_duplicated_messages_do_not_change_the_loop(seed: int) -> None:
    """The second copy of each message comes at any time; the numbers are the same to the last
    bit."""
    loops = [place("approach").loop.fork(seed) for _ in range(2)]
    late_s = random.Random(seed).uniform(0.0, 3.0 * T)
    loops[1].links.append(LinkFault("twice", late_s=late_s))
    for loop in loops:
        loop.run(loop.now_s + 1.0)
    once, twice = (
        [message for _, message in loop.told or [] if isinstance(message, Telemetry)]
        for loop in loops
    )
    assert len(once) > 45
    assert [view.arms[0].x_r_um for view in once] == [view.arms[0].x_r_um for view in twice]
    assert {echo.state for _, echo in loops[1].applied} == {"armed"}
    assert loops[1].runner("estimator").refused > 40
