"""A flag of one message, which one reading confirms, is not lost with that message or reading.

The flag for zeroing the force is in one command: the voltage of its tick passes it to the
estimator, and the next reading confirms it. Whichever of them is lost, the zero is taken in the
same rest.
"""

from collections.abc import Callable
from typing import Any

import pytest

from pincette.core.codec import decode
from pincette.core.messages import Applied, Command, Estimate, Message, Position, Telemetry
from pincette.core.topics import Topic
from tests.support.reactions import TRIPPED
from tests.support.scripted import PROGRAM
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_places import near_rig

LONGEST_S = 9.0
SOON = 5
"""Samples after the first request in which the zero is in use."""
T = 0.02


class LosingLoop(VirtualLoop):
    """A loop in which the first message that satisfies a condition is lost on its way."""

    loses: Callable[["LosingLoop", str, Message], bool] | None = None
    lost_s: float | None = None
    zero_seq: int | None = None
    """Tick of the first command that carried a zero."""

    def send(self, link: tuple[str, str], topic: Topic, payload: bytes) -> None:
        """Send bytes to one program, unless they are to be lost."""
        message = decode(topic.message, payload)
        if isinstance(message, Command) and message.zero and self.zero_seq is None:
            self.zero_seq = message.seq
        if self.lost_s is None and self.loses is not None and self.loses(self, link[1], message):
            self.lost_s = self.now_s
            return
        super().send(link, topic, payload)

    def told_of(self, kind: type[Any]) -> list[Any]:
        """Return the messages of a kind, in order."""
        assert self.told is not None
        return [message for _, message in self.told if isinstance(message, kind)]


def played(loses: Callable[[LosingLoop, str, Message], bool]) -> LosingLoop:
    """Play a short grip in which a message is lost, and check that it was lost."""
    loop = LosingLoop(near_rig())
    loop.loses = loses
    loop.run(0.1)
    loop.reset()
    loop.arm(PROGRAM)
    began_s = loop.now_s
    loop.run(began_s + LONGEST_S, lambda: loop.now_s > began_s + 0.2 and loop.newest.final)
    assert loop.lost_s is not None
    return loop


def carries_zero(_loop: LosingLoop, to: str, message: Message) -> bool:
    if to == "actuator":
        return isinstance(message, Command) and message.zero
    return to == "estimator" and isinstance(message, Applied) and message.zero


def command_with_zero(loop: LosingLoop, to: str, message: Message) -> bool:
    return isinstance(message, Command) and carries_zero(loop, to, message)


def voltage_with_zero(loop: LosingLoop, to: str, message: Message) -> bool:
    return isinstance(message, Applied) and carries_zero(loop, to, message)


def answers(loop: LosingLoop, message: Position | Estimate) -> bool:
    return loop.zero_seq is not None and message.seq == loop.zero_seq + 1


def sample_of_zero(loop: LosingLoop, to: str, message: Message) -> bool:
    return to == "estimator" and isinstance(message, Position) and answers(loop, message)


def estimate_of_zero(loop: LosingLoop, to: str, message: Message) -> bool:
    return to == "controller" and isinstance(message, Estimate) and answers(loop, message)


@pytest.mark.parametrize(
    "loses", [command_with_zero, voltage_with_zero, sample_of_zero, estimate_of_zero]
)
def test_a_zero_is_taken_even_if_any_one_of_its_messages_is_lost(
    loses: Callable[[LosingLoop, str, Message], bool],
) -> None:
    loop = played(loses)
    assert not any(one.state in TRIPPED for one in loop.told_of(Applied))
    assert loop.told_of(Telemetry)[-1].outcome == "gripped"
    assert loop.zero_seq is not None
    last = loop.zero_seq + SOON
    requested = [one.seq for one in loop.told_of(Command) if one.zero and one.seq <= last]
    ages_s = {one.seq: one.arms[0].zero_age_s for one in loop.told_of(Estimate) if one.valid}
    # The zero of the first rest holds until that of the next one is requested.
    assert ages_s[last] is not None
    assert requested == [loop.zero_seq, again(ages_s, last)]


def again(ages_s: dict[int, float | None], at: int) -> int:
    """Return the tick whose voltage carried the zero in use at a sample."""
    age_s = ages_s[at]
    assert age_s is not None
    return at - round(age_s / T) - 1
