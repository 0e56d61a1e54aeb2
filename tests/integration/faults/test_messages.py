"""Rows 4 and 15: whatever value a field has, no handler raises and no voltage leaves its limits."""

from itertools import cycle, pairwise
from math import inf, nan
from typing import Any, get_args, get_origin, get_type_hints

import pytest

from pincette.core.messages import Applied, Command, Estimate, Message, Position
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_faults import LinkFault
from tests.support.virtual_loop_places import T, place

SOURCES: dict[type[Message], str] = {
    Position: "sensor",
    Estimate: "estimator",
    Command: "controller",
    Applied: "actuator",
}


def hints_of(kind: type[Message]) -> dict[str, Any]:
    """Return the fields of a message and of the record of its arm, with their types."""
    own = get_type_hints(kind)
    return own | get_type_hints(get_args(own["arms"])[0])


FIELDS = [
    pytest.param(source, field, id=f"{kind.__name__}.{field}")
    for kind, source in SOURCES.items()
    for field in hints_of(kind)
]
NO_NUMBERS = (nan, inf, -inf)
NO_VALUES: tuple[Any, ...] = (b"\0", [], [1.0], {"a": 1}, -(2**63))
ABSURD: tuple[Any, ...] = (1e300, -1e300, 1e15, 2**63, 2**53, 1000, 1, 0, -1, -0.0, 5e-324, "x", "")
OPTIONAL: tuple[Any, ...] = (None, True, False)
ONCE_S = 0.9 * T
WATCHED_S = 4.5 * T


def spoilt(state: str, source: str, field: str, value: Any, *, once: bool = True) -> VirtualLoop:
    """Return a loop in which a field has another value, once or from here on."""
    loop = place(state).loop.fork(1)
    loop.run(loop.now_s + 0.4 * T)
    end_s = loop.now_s + (ONCE_S if once else WATCHED_S)
    loop.links.append(LinkFault("corrupt", source, end_s=end_s, field=field, value=value))
    loop.run(loop.now_s + WATCHED_S)
    return loop


def refused(loop: VirtualLoop) -> int:
    """Return the number of payloads that were invalid."""
    return sum(program.refused for program in loop.programs.values())


def check_voltages(loop: VirtualLoop) -> None:
    """Check that voltages are within the limits, and that their steps respect the slew limit and
    the ramp."""
    limits, safety = loop.rig.limits, loop.rig.safety
    ramp_V = (limits.voltage_max_V - limits.voltage_min_V) * 0.35 * T / safety.ramp_s
    step_V = max(limits.slew_V_per_s * T, ramp_V)
    assert len(loop.put_out) > 3
    for (_, before_V), (_, after_V) in pairwise(loop.put_out):
        assert limits.voltage_min_V <= after_V <= limits.voltage_max_V
        assert abs(after_V - before_V) <= step_V + 0.001


def is_float(source: str, field: str) -> bool:
    kind = next(kind for kind, name in SOURCES.items() if name == source)
    return "float" in str(hints_of(kind)[field])


def is_list(source: str, field: str) -> bool:
    kind = next(kind for kind, name in SOURCES.items() if name == source)
    return get_origin(hints_of(kind)[field]) is tuple


@pytest.mark.parametrize(("source", "field"), FIELDS)
def test_an_invalid_value_is_refused_in_the_same_cycle_and_counted(source: str, field: str) -> None:
    values = (*NO_VALUES, *(NO_NUMBERS if is_float(source, field) else ()))
    for value in values:
        if value == [] and is_list(source, field):
            continue  # the value that means that there is nothing
        loop = spoilt("approach", source, field, value)
        listeners = {"sensor": 2, "actuator": 1, "estimator": 1, "controller": 1}[source]
        assert refused(loop) == listeners, f"{source}.{field} = {value!r}"
        check_voltages(loop)
        if source != "sensor":
            states = {echo.state for _, echo in loop.applied}
            assert states == {"armed"}, f"a false trip by {source}.{field} = {value!r}, once"


@pytest.mark.parametrize(("source", "field"), FIELDS)
def test_no_value_makes_a_handler_raise_or_a_voltage_exceed_its_limits(
    source: str, field: str
) -> None:
    """The values come alternately in the approach and in the hold."""
    for value, state in zip((*ABSURD, *OPTIONAL), cycle(("approach", "hold")), strict=False):
        check_voltages(spoilt(state, source, field, value, once=value in ABSURD))


@pytest.mark.parametrize("source", SOURCES.values())
def test_extreme_numbers_have_no_lasting_effect(source: str) -> None:
    """Values sent once neither block valid values afterwards nor stay in a memory."""
    for field, value in (("seq", 2**53), ("seq", -1), ("epoch", 0), ("epoch", 2**53)):
        if source == "sensor":
            continue  # a sample that all programs miss: see test_matrix
        loop = spoilt("approach", source, field, value)
        loop.run(loop.now_s + 10.0 * T)
        last = loop.newest
        assert (last.state, last.answered) == ("armed", True), f"{source}.{field} = {value}"
        for _, message in (loop.told or [])[-8:]:
            if isinstance(message, Estimate):
                assert message.valid, f"{source}.{field} = {value}: {message.fault}"
