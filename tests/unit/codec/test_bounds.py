"""Every number has a limit, every refusal names it, and real messages stay far below it."""

import math
from enum import EnumType
from typing import Any, get_args, get_origin, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import fields, replace

from pincette.control.quantities import (
    LARGEST,
    LARGEST_INT,
    LAST_SEQ,
    MAX_DOCUMENT,
    MAX_ITEMS,
    MAX_TEXT,
    Document,
)
from pincette.core.codec import MAX_BYTES, decode, encode
from pincette.core.codec.refusals import CodecError, msgpack
from pincette.core.faults import Cause
from pincette.core.messages import (
    Applied,
    Arm,
    Burst,
    Command,
    Estimate,
    GroundTruth,
    Message,
    Position,
    Telemetry,
    Timing,
    Trip,
)
from pincette.core.messages.arms import ArmPosition
from pincette.core.units import UNITS, unit_of
from tests.support.arms import with_arm
from tests.support.bounds import largest, whole_range

POSITION = Position(7, 3, 0.06, (ArmPosition(12.5, valid=True),))


def record_of_arm(kind: type) -> type:
    """The record of an arm in a message."""
    return get_args(get_type_hints(kind)["arms"])[0]


SAMPLES = (Position, Estimate, Command, Applied, Telemetry, GroundTruth)
FLOATS = [
    (kind, place, name)
    for kind in SAMPLES
    for place, record in (("", kind), ("arms.", record_of_arm(kind)))
    for name, hint in get_type_hints(record).items()
    if hint in (float, float | None)
]


def tree_of(kind: type) -> dict[str, Any]:
    """Return the fields of a valid message."""
    values = {float: 1.5, int: 1, bool: True, str: "a"}
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind)]
    tree = {name: values.get(hints[name], _odd(hints[name])) for name in names}
    return tree | {"arms": [tree_of(record_of_arm(kind))]} if "arms" in tree else tree


def changed(kind: type[Message], **changes: object) -> dict[str, Any]:
    """Return the fields of a valid message, with some of its own or of its arm changed."""
    tree = tree_of(kind)
    for name, value in changes.items():
        (tree if name in tree else tree["arms"][0])[name] = value
    return tree


def _odd(hint: Any) -> Any:
    """Return a valid value of a field that is neither a number nor a text."""
    if isinstance(hint, EnumType):
        return str(next(iter(hint.__members__.values())))
    return [] if get_origin(hint) is tuple else None


def refusal(kind: type[Message], **fields: object) -> str:
    with pytest.raises(CodecError) as caught:
        decode(kind, msgpack.packb(changed(kind, **fields)))
    return str(caught.value)


def test_every_unit_has_a_bound() -> None:
    assert set(LARGEST) == {*UNITS.values(), ""}
    assert all(bound <= LARGEST_INT for bound in LARGEST.values()), "a whole number must stay exact"


@pytest.mark.parametrize(("kind", "place", "name"), FLOATS)
def test_a_number_is_accepted_up_to_its_bound_only(
    kind: type[Message], place: str, name: str
) -> None:
    bound = largest(name)
    for value in (bound, -bound, -0.0, 5e-324, int(bound)):
        message: Any = decode(kind, msgpack.packb(changed(kind, **{name: value})))
        read = getattr(message.arms[0] if place else message, name)
        assert type(read) is float
        assert (read, math.copysign(1.0, read)) == (value, math.copysign(1.0, value))
    for value in (math.nextafter(bound, math.inf), -1e300, 2**63, -(2**63)):
        stated = refusal(kind, **{name: value})
        assert stated.startswith(f"{kind.__name__}.{place}{name} = ")
        assert stated.endswith(f"beyond ±{bound:g} {unit_of(name)}".rstrip())
    for value in (math.nan, math.inf, -math.inf):
        assert refusal(kind, **{name: value}).endswith("not a finite number")


def test_a_refusal_names_message_field_value_unit_and_limit() -> None:
    assert refusal(Position, x_um=1e300) == "Position.arms.x_um = 1e+300 µm: beyond ±1e+09 µm"
    assert refusal(Command, voltage_V=-2e6) == "Command.arms.voltage_V = -2e+06 V: beyond ±1e+06 V"
    assert refusal(Position, seq=-2) == f"Position.seq = -2: not within -1 to {LAST_SEQ}"
    assert refusal(Position, valid=1) == "Position.arms.valid = '1': neither true nor false"
    assert refusal(Position, x_um=True) == "Position.arms.x_um = 'True': not a number"
    assert refusal(Position, fault=b"") == "Position.arms.fault: not a map"
    assert refusal(Timing, service=b"") == "Timing.service = (bytes): not a text"
    assert refusal(Applied, state="gone").startswith("Applied.state = 'gone': not one of latched")


@pytest.mark.parametrize("name", ["epoch", "seq", "owner"])
def test_a_whole_number_stays_within_what_every_language_can_represent(name: str) -> None:
    least, most = whole_range(name)
    for value in (least, 0, most):
        read = decode(Command, msgpack.packb(tree_of(Command) | {name: value}))
        assert getattr(read, name) == value
    for value in (least - 1, most + 1, 2**63, 2**64 - 1):
        assert f"Command.{name} = {value}: not within {least} to" in refusal(
            Command, **{name: value}
        )


def test_counters_have_a_lower_bound() -> None:
    assert (whole_range("epoch")[0], whole_range("seq")[0]) == (0, -1)
    assert "epoch = -1" in refusal(Position, epoch=-1)
    assert decode(Position, encode(replace(POSITION, seq=-1))).seq == -1


def test_the_time_of_the_last_possible_sample_is_within_bounds() -> None:
    longest_period_s = 1.0
    assert (LAST_SEQ + 1) * longest_period_s <= LARGEST["s"]


def test_received_texts_are_bounded_and_own_texts_are_truncated() -> None:
    message = refusal(Timing, service="x" * (MAX_TEXT + 1))
    assert message.endswith(f"a text of at most {MAX_TEXT} characters, it has {MAX_TEXT + 1}")
    long = decode(Trip, encode(Trip(Cause.ESTOP, words="µ" * 5000)))
    assert long.words == "µ" * MAX_TEXT


def test_a_document_that_is_too_long_is_refused_and_not_truncated() -> None:
    whole = Arm(1, 1, "d", Document("x" * MAX_DOCUMENT))
    assert decode(Arm, encode(whole)) == whole
    longer = replace(whole, calibration=Document("x" * (MAX_DOCUMENT + 1)))
    with pytest.raises(CodecError, match=rf"Arm\.calibration: .* has {MAX_DOCUMENT + 1}$"):
        decode(Arm, encode(longer))


def test_lists_are_limited_before_they_are_read() -> None:
    burst = Burst(7, 3, 100.0, (0.5,) * MAX_ITEMS, (), True)
    assert decode(Burst, encode(burst)) == burst
    with pytest.raises(CodecError, match=f"{MAX_ITEMS + 1} exceeds max_array_len"):
        decode(Burst, encode(replace(burst, x_um=(0.5,) * (MAX_ITEMS + 1))))
    with pytest.raises(CodecError, match=f"bytes, limit {MAX_BYTES}"):
        decode(Burst, b"\x00" * (MAX_BYTES + 1))


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_position_beyond_its_bound_is_refused_and_never_changed(x_um: float) -> None:
    payload = encode(with_arm(POSITION, x_um=x_um))
    if abs(x_um) <= LARGEST["µm"]:
        assert decode(Position, payload).arms[0].x_um == x_um
    else:
        with pytest.raises(CodecError, match=r"Position\.arms\.x_um = "):
            decode(Position, payload)
