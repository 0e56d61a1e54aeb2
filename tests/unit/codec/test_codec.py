"""The codec carries every message unchanged and refuses everything else."""

import math
from typing import Any, cast, get_type_hints

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from pincette.control.laws.parameters import Gain, LawSpec
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Press
from pincette.control.planning.sweep import Sweep
from pincette.control.quantities import LARGEST, LARGEST_INT, LAST_SEQ
from pincette.core.codec import MAX_BYTES, decode, encode
from pincette.core.codec.refusals import CodecError
from pincette.core.faults import Acted, Cause, Fault, FaultCode, Mode, Outcome, Value
from pincette.core.messages import Applied, Command, Estimate, Load, Position, Telemetry
from pincette.core.messages.arms import (
    ArmApplied,
    ArmCommand,
    ArmEstimate,
    ArmPosition,
    ArmTelemetry,
)
from tests.support.laws import law_settings

packb = cast(Any, msgpack).packb
EPOCH, SEQ = st.integers(0, LARGEST_INT), st.integers(-1, LAST_SEQ)
T_S, X_UM, VOLTAGE_V = (st.floats(-LARGEST[unit], LARGEST[unit]) for unit in ("s", "µm", "V"))
VALUES = st.builds(Value, st.text(max_size=40), st.none() | st.floats(-1e15, 1e15))
FAULTS = st.none() | st.builds(
    Fault, st.sampled_from(FaultCode), st.lists(VALUES, max_size=4).map(tuple), st.text(max_size=40)
)
TIPS = st.builds(ArmPosition, X_UM, st.booleans(), FAULTS)
ASKED = st.builds(ArmCommand, VOLTAGE_V)
POSITIONS = st.builds(Position, EPOCH, SEQ, T_S, st.lists(TIPS, min_size=1, max_size=2).map(tuple))
OF_COMMAND = st.lists(ASKED, min_size=1, max_size=2).map(tuple)
COMMANDS = st.builds(Command, EPOCH, SEQ, EPOCH, OF_COMMAND, *[st.booleans() for _ in range(4)])
GUARDS = Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.9, 1.0)
LOAD = Load(Program((Press("hold", None, to_mN=20.0),), GUARDS, 2.17))
POSITION = Position(7, 3, 0.06, (ArmPosition(12.5, valid=True),))


@given(POSITIONS)
def test_a_position_is_unchanged_after_encoding_and_decoding(position: Position) -> None:
    assert decode(Position, encode(position)) == position


@given(COMMANDS)
def test_a_command_is_unchanged_after_encoding_and_decoding(command: Command) -> None:
    assert decode(Command, encode(command)) == command


def test_a_nested_program_is_unchanged_after_encoding_and_decoding() -> None:
    assert decode(Load, encode(LOAD)) == LOAD


LAWS = st.builds(
    LawSpec,
    st.sampled_from(["pbsmic", "dsmifc", "another"]),
    st.sampled_from(["consistent", "printed", "identified"]),
    st.sampled_from(["planned", "newest"]),
    st.lists(st.builds(Gain, st.sampled_from(["K_P", "K_f"]), st.floats(-1e9, 1e9))).map(tuple),
)


@given(st.lists(LAWS, max_size=4))
def test_the_laws_of_a_program_are_unchanged_after_encoding_and_decoding(
    laws: list[LawSpec],
) -> None:
    segments = (Press("load", 1.0, law=len(laws), to_mN=20.0),)
    load = Load(replace(LOAD.program, segments=segments, laws=tuple(laws)))
    assert decode(Load, encode(load)) == load


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("scheme", None, "laws.scheme = 'None': not a text"),
        ("set", "mine", "laws.set = 'mine': not one of consistent, identified, printed"),
        ("force_age", "oldest", "laws.force_age = 'oldest': not one of newest, planned"),
        ("gains", [{"name": "K_P", "value": "1"}], "gains.value = '1': not a number"),
        ("gains", [{"name": "K_f", "value": math.nan}], "gains.value = nan: not a finite number"),
    ],
)
def test_a_faulty_law_is_refused_by_name(name: str, value: object, text: str) -> None:
    with pytest.raises(CodecError) as refusal:
        decode(Load, with_law({name: value}))
    assert text in str(refusal.value)


def test_a_law_with_an_extra_member_is_refused() -> None:
    with pytest.raises(CodecError, match="laws: fields missing or unknown: K_D"):
        decode(Load, with_law({"K_D": 1.0}))


def with_law(changed: dict[str, object]) -> bytes:
    """Return a program with one law, as bytes, with these members of the law changed."""
    program = replace(LOAD.program, laws=(law_settings().spec(),))
    tree = cast(Any, msgpack).unpackb(encode(Load(program)))
    tree["program"]["laws"][0] |= changed
    return packb(tree)


def test_messages_can_be_read_without_pincette() -> None:
    tree = cast(Any, msgpack).unpackb(encode(POSITION))
    assert tree == {
        "epoch": 7,
        "seq": 3,
        "t_s": 0.06,
        "arms": [{"x_um": 12.5, "valid": True, "fault": None}],
    }


MESSAGES = (Position, Estimate, Command, Applied, Telemetry)
RECORDS = (ArmPosition, ArmEstimate, ArmCommand, ArmApplied, ArmTelemetry)


@pytest.mark.parametrize("kind", MESSAGES)
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, "1", None, [1.0], {"a": 1}, 2**60])
def test_no_field_accepts_another_type(kind: type, bad: object) -> None:
    record = RECORDS[MESSAGES.index(kind)]
    hints = get_type_hints(kind)
    del hints["arms"]
    of_arm = get_type_hints(record)
    whole: dict[Any, object] = {
        int: 1,
        bool: True,
        str: "a",
        int | None: 1,
        Sweep | None: None,
        Fault | None: None,
        tuple[Fault, ...]: [],
        tuple[Acted, ...]: [],
        Mode: "idle",
        Cause: "",
        Outcome: "",
    }
    good = {name: whole.get(hint, 1.5) for name, hint in hints.items()}
    arm = {name: whole.get(hint, 1.5) for name, hint in of_arm.items()}
    for name, hint in (hints | of_arm).items():
        allowed = {int: (int,), bool: (bool,), str: (str,), float: (float, int)}
        codes = {Mode: (), Cause: (), Outcome: (), tuple[Fault, ...]: (), tuple[Acted, ...]: ()}
        none = {
            int | None: (int, type(None)),
            Sweep | None: (type(None),),
            Fault | None: (type(None),),
        }
        kinds = (allowed | codes | none).get(hint, (float, int, type(None)))
        finite = not isinstance(bad, float) or math.isfinite(bad)
        big = isinstance(bad, int) and hint not in (int, int | None)
        if type(bad) in kinds and finite and not big:
            continue
        arms, own = ([arm | {name: bad}], {}) if name in arm else ([arm], {name: bad})
        with pytest.raises(CodecError, match=name):
            decode(kind, packb({**good, "arms": arms, **own}))


def test_missing_and_unknown_fields_are_named() -> None:
    tree: dict[str, Any] = {"epoch": 7, "seq": 3, "arms": [], "colour": 1}
    with pytest.raises(CodecError, match="colour, t_s"):
        decode(Position, packb(tree))


def test_the_size_of_a_payload_is_bounded() -> None:
    with pytest.raises(CodecError, match="limit 524288"):
        decode(Position, b"\x00" * (MAX_BYTES + 1))


@settings(max_examples=200)
@given(st.binary(max_size=200))
def test_random_bytes_raise_only_the_documented_error(noise: bytes) -> None:
    with pytest.raises(CodecError):
        decode(Command, noise)


@given(POSITIONS, st.integers(0, 60))
def test_truncated_bytes_are_refused(position: Position, cut: int) -> None:
    payload = encode(position)
    with pytest.raises(CodecError):
        decode(Position, payload[: max(0, len(payload) - 1 - cut)])
