"""Rows 9, 14 and 15: two controllers, repeated old commands, foreign publishers; none of them is
obeyed."""

import random
from functools import partial

import pytest
from msgspec.structs import replace

from pincette.core.codec import encode
from pincette.core.messages import Applied, Command, Estimate, Position, Status, StatusRequest
from pincette.core.messages.arms import ArmCommand
from pincette.core.topics import APPLIED, COMMAND, ESTIMATE, POSITION
from pincette.core.wording import status_text
from tests.support.arms import with_arm
from tests.support.scripted import PROGRAM
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_places import EPOCH, T, place

WATCHED_S = 1.0
TIMES_THE_RATE = 10


def echoes(loop: VirtualLoop) -> list[Applied]:
    """Return the echoes since the controller first published in this loop."""
    first = min(item.seq for item in commands(loop) if item.valid)
    return [echo for _, echo in loop.applied if echo.seq >= first and echo.epoch == newest(loop)]


def newest(loop: VirtualLoop) -> int:
    return loop.runner("actuator").state.epoch


def commands(loop: VirtualLoop) -> list[Command]:
    return [message for _, message in loop.told or [] if isinstance(message, Command)]


def check_obeys(loop: VirtualLoop, owner: int, least_share: float = 0.9) -> None:
    """Check that the actuator follows one owner in every tick, and that no other sender trips
    it."""
    by_seq = {item.seq: item.arms[0].voltage_V for item in commands(loop) if item.owner == owner}
    answered = [echo for echo in echoes(loop) if echo.answered]
    assert {echo.state for echo in echoes(loop)} == {"armed"}
    assert len(answered) >= least_share * WATCHED_S / T
    limited = [echo for echo in answered if echo.arms[0].limits_active]
    half_V = 0.5 * loop.rig.output.step_V + 1e-12
    wrong = [
        echo
        for echo in answered
        if echo.seq not in by_seq or abs(echo.arms[0].voltage_V - by_seq[echo.seq]) > half_V
    ]
    assert set(map(id, wrong)) <= set(map(id, limited))


def status(loop: VirtualLoop) -> Status:
    reply = loop.call("actuator", StatusRequest())
    assert isinstance(reply, Status)
    return reply


def test_the_first_of_two_controllers_keeps_the_rig_and_the_second_is_refused() -> None:
    for state in ("approach", "hold", "paused"):
        loop = place(state).loop.fork(3)
        owner = loop.runner("controller").instance
        loop.add_rival(PROGRAM, EPOCH)
        loop.run(loop.now_s + WATCHED_S)
        rival = loop.runner("rival").instance
        assert rival != owner
        assert len([item for item in commands(loop) if item.owner == rival and item.valid]) > 40
        check_obeys(loop, owner)
        reported = status(loop)
        assert reported.refused >= 40
        assert str(rival) in status_text(reported), "the alarm must name the unknown controller"


def test_a_second_controller_cannot_arm_the_rig() -> None:
    loop = place("idle").loop.fork(3)
    loop.add_rival(PROGRAM, EPOCH)
    loop.arm(PROGRAM, EPOCH + 1)
    loop.run(loop.now_s + 0.2)
    check_obeys(loop, loop.runner("controller").instance, least_share=0.1)


def test_repeated_old_commands_are_refused_individually() -> None:
    loop = place("approach").loop.fork(4)
    loop.run(loop.now_s + 0.3)
    old = commands(loop)
    assert len(old) >= 10
    before = status(loop).refused
    chance = random.Random(4)
    for count in range(200):
        again = chance.choice(old)
        forged = with_arm(again, voltage_V=3.9)
        at_s = loop.now_s + chance.uniform(0.0, WATCHED_S)
        payload = encode(forged if count % 2 else again)
        loop.call_at(at_s, partial(stranger_says, payload=payload))
    loop.run(loop.now_s + WATCHED_S)
    check_obeys(loop, loop.runner("controller").instance)
    assert status(loop).refused - before >= 190


def stranger_says(loop: VirtualLoop, payload: bytes, to: str = "actuator") -> None:
    """Publish on the topic that the program receives, with a payload of its type."""
    topics = {"actuator": COMMAND, "estimator": POSITION, "controller": ESTIMATE}
    topic = APPLIED if to == "estimator" and b"command_age_s" in payload else topics[to]
    loop.send(("stranger", to), topic, payload)


@pytest.mark.parametrize(
    ("kind", "listener"),
    [(Position, "estimator"), (Estimate, "controller"), (Applied, "estimator")],
)
def test_a_flood_of_messages_of_other_epochs_displaces_no_valid_message(
    kind: type[Position | Estimate | Applied], listener: str
) -> None:
    """Forty times the rate, on every topic but that of the commands."""
    loop = place("approach").loop.fork(6)
    loop.run(loop.now_s + 2.0 * T)
    sample = next(item for _, item in reversed(loop.told or []) if isinstance(item, kind))
    chance = random.Random(6)
    begun_s, count = loop.now_s, round(40 * WATCHED_S / T)
    for number in range(count):
        forged = replace(sample, epoch=chance.getrandbits(40), seq=sample.seq + number // 40)
        deed = partial(stranger_says, payload=encode(forged), to=listener)
        loop.call_at(begun_s + number * WATCHED_S / count, deed)
    loop.run(begun_s + WATCHED_S)
    check_obeys(loop, loop.runner("controller").instance)


def test_a_flood_of_forged_and_invalid_commands_is_refused_and_the_loop_continues() -> None:
    """Ten times the rate: other owners, other epochs, the future, the past, and invalid
    messages."""
    loop = place("approach").loop.fork(5)
    chance = random.Random(5)
    good = Command(
        EPOCH, 0, loop.runner("controller").instance, (ArmCommand(3.9),), True, False, False, True
    )
    begun_s, count = loop.now_s, round(TIMES_THE_RATE * WATCHED_S / T)
    for number in range(count):
        forged = replace(good, seq=chance.choice((-1, 0, 1, 2**40, chance.randrange(200))))
        match number % 4:
            case 0:
                payload = encode(replace(forged, owner=chance.getrandbits(40)))
            case 1:
                payload = encode(replace(forged, epoch=chance.getrandbits(40)))
            case 2:
                payload = chance.randbytes(chance.randrange(200))
            case _:
                payload = encode(replace(good, seq=2**40))
        at_s = begun_s + number * WATCHED_S / count
        loop.call_at(at_s, partial(stranger_says, payload=payload))
    loop.run(begun_s + WATCHED_S)
    check_obeys(loop, good.owner)
    unreadable = loop.programs["actuator"].refused
    assert unreadable >= count // 4
    assert unreadable + status(loop).refused >= 0.98 * count, "refused commands must be counted"
