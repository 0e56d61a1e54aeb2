"""In lockstep every tick ends once, whatever the order in which messages reach the actuator."""

from dataclasses import replace
from itertools import permutations, product

import pytest

from pincette.core.faults import Cause
from pincette.core.messages import Applied, Message, Trip
from pincette.core.service import DeviceCommand, SetVoltage
from pincette_actuator.requests import handle
from pincette_actuator.step import Inputs, step

from .bench import CONFIG, T, command, holding, position

LOCKSTEP = replace(CONFIG, lockstep=True)
TICKS = (1, 2, 3)
"""Ticks of the test; that of ``holding`` is 0."""
ORDERS = ("position command", "command position")
TRIPPED = tuple(permutations(("trip", "position", "command")))


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("others", list(product(ORDERS, repeat=2)))
@pytest.mark.parametrize("order", TRIPPED, ids=" ".join)
@pytest.mark.parametrize("tripped", TICKS[:-1])
def test_each_tick_ends_exactly_once(
    tripped: int, order: tuple[str, ...], others: tuple[str, str], *, held: bool
) -> None:
    state, left = holding(held=held), list(others)
    for seq in TICKS:
        received: list[Message | DeviceCommand] = []
        for what in order if seq == tripped else left.pop().split():
            if what == "trip":
                state, _, outputs = handle(LOCKSTEP, state, Trip(Cause.ABORT), seq * T)
            else:
                state, outputs = step(LOCKSTEP, state, coming(what, seq, held=held), seq * T)
            received += outputs
        echoes = [one for one in received if isinstance(one, Applied)]
        assert [echo.seq for echo in echoes] == [seq]
        assert sum(isinstance(one, SetVoltage) for one in received) == 1
        if echoes[0].final:
            break
    assert state.mode in (("frozen",) if held else ("ramping", "latched"))


def coming(what: str, seq: int, *, held: bool) -> Inputs:
    return position(seq) if what == "position" else command(seq, held=held)
