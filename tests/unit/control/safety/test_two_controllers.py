"""Two controllers at once, in every drawn order: no command of the second one is ever accepted.

The state after an interleaving is that after the first one alone, except for counters.
"""

import random
from collections.abc import Iterator

import pytest
from msgspec.structs import replace

from pincette.control.safety.admission import CommandFacts, sampled
from pincette.control.safety.arm import ArmFacts
from pincette.control.safety.latch import pass_time
from pincette.control.safety.state import NO_UNAUTHORIZED, SafetyState

from .bench import EPOCH, LIMITS, OWNER, T, command, offered, ready

TICKS = 6
WORLDS = 64
"""Runs of the first controller from which interleavings are made."""
Event = tuple[float, CommandFacts | None, int]
"""Time, a command (None: the sample arrives), number."""


def first(chance: random.Random) -> list[Event]:
    """Return samples and commands of the first controller, some of them odd, late or lost."""
    events: list[Event] = []
    for seq in range(TICKS):
        events.append((seq * T, None, seq))
        sent = command(
            seq=seq - chance.choice((0, 0, 0, 0, 1)),
            voltage_V=chance.choice((0.25, 0.5, 9.0, -0.5)),
            part_held=chance.random() < 0.5,
            valid=chance.random() < 0.9,
            force_mN=chance.choice((None, 1.0, 60.0)),
            x_d_um=chance.choice((None, 1.0, 9.0)),
        )
        if chance.random() < 0.9:
            events.append((seq * T + chance.choice((0.004, 0.019)), sent, seq))
    return events


def second(chance: random.Random) -> CommandFacts:
    """Return a command of another sender: another owner or epoch, or a recording of the last
    one."""
    owner, epoch = chance.choice(((OWNER + 1, EPOCH), (OWNER, EPOCH - 1), (OWNER + 1, EPOCH + 1)))
    return CommandFacts(
        epoch,
        owner,
        chance.choice((*range(-1, TICKS + 2), 2**62)),
        (
            ArmFacts(
                chance.choice((-1.0, 0.0, 1.0, 4.0, 1e300, float("nan"))),
                force_mN=chance.choice((None, 99.0, float("inf"))),
                x_d_um=chance.choice((None, -99.0)),
            ),
        ),
        part_held=chance.random() < 0.5,
        final=chance.random() < 0.3,
        valid=chance.random() < 0.8,
        sweep_V=chance.choice((None, 0.1)),
    )


def befallen(state: SafetyState, event: Event) -> SafetyState:
    at_s, reported, seq = event
    if reported is None:
        return sampled(LIMITS, state, seq, (1.0,), at_s)
    return offered(state, reported, at_s)


def ending(state: SafetyState) -> SafetyState:
    """Return the state after some time, without counters."""
    state = pass_time(LIMITS, state, TICKS * T)
    return replace(state, refused=0, refusal=None, unauthorized=NO_UNAUTHORIZED)


def interleaved(count: int, seed: int) -> Iterator[int]:
    """Play interleavings, each compared with the first controller alone; yields how many
    commands of the second arrived."""
    chance = random.Random(seed)
    worlds = [first(chance) for _ in range(WORLDS)]
    alone: list[SafetyState] = []
    for world in worlds:
        state = ready()
        for event in world:
            state = befallen(state, event)
        alone.append(ending(state))
    unauthorized = [second(chance) for _ in range(WORLDS)]
    for number in range(count):
        world = worlds[number % WORLDS]
        state, came = ready(), 0
        for event in world:
            while chance.random() < 0.5:
                state, came = offered(state, chance.choice(unauthorized), event[0]), came + 1
            state = befallen(state, event)
        assert ending(state) == alone[number % WORLDS], (seed, number)
        yield came


def test_the_commands_of_the_first_controller_lead_to_several_modes_and_voltages() -> None:
    chance = random.Random(1)
    ends: set[tuple[str, float]] = set()
    for _ in range(WORLDS):
        state = ready()
        for event in first(chance):
            state = befallen(state, event)
        silent = pass_time(LIMITS, state, (TICKS + 3) * T)
        ends |= {(state.mode, state.arms[0].voltage_V), (silent.mode, silent.arms[0].voltage_V)}
    assert {mode for mode, _ in ends} >= {"armed", "ramping", "frozen"}
    assert len(ends) > 10


def test_no_command_of_the_second_is_accepted_in_two_thousand_interleavings() -> None:
    assert sum(interleaved(2_000, seed=20)) > 10_000


@pytest.mark.slow
def test_no_command_of_the_second_is_accepted_in_a_million_interleavings() -> None:
    assert sum(interleaved(1_000_000, seed=21)) > 5_000_000
