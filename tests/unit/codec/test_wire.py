"""A program of another wire version is named, together with the side to update."""

import pytest

from pincette.core.codec import decode
from pincette.core.codec.refusals import CodecError, msgpack
from pincette.core.codec.wire import ENCODING, explained, of_other_wires, update_which
from pincette.core.messages import Position
from pincette.core.topics import ROOT, WIRE, live_key, live_key_of_any_wire

ARM = {"x_um": 1.0, "valid": True, "fault": None}
OTHER_FIELDS = {"epoch": 7, "seq": 3, "arms": [ARM], "colour": 1}
SOUND = {"epoch": 7, "seq": 3, "t_s": 0.1, "arms": [ARM]}


def refused(tree: object, encoding: str) -> str:
    with pytest.raises(CodecError) as caught:
        decode(Position, msgpack.packb(tree))
    return explained(caught.value, encoding, "sensor")


def test_keys_and_encoding_contain_the_wire_version() -> None:
    assert ROOT.endswith(f"/v{WIRE}")
    assert ENCODING.endswith(f".v{WIRE}")


def test_the_message_names_the_older_program_as_the_one_to_update() -> None:
    assert update_which("controller", WIRE + 1) == (
        "controller runs with wire version 3, this program has 2: update this program"
    )
    assert update_which("controller", WIRE - 1).endswith("update the controller")


@pytest.mark.parametrize("wire", [0, 1, 17])
def test_fields_of_another_version_are_recognized(wire: int) -> None:
    message = refused(OTHER_FIELDS, ENCODING.replace(f"v{WIRE}", f"v{wire}"))
    assert "fields missing or unknown: colour, t_s" in message
    assert message.endswith(update_which("sensor", wire))


def test_other_fields_of_the_same_wire_version_are_reported_as_another_build() -> None:
    message = refused(OTHER_FIELDS, ENCODING)
    assert "sensor states wire version 2, as this program does" in message
    assert "the same version of pincette" in message


@pytest.mark.parametrize("encoding", ["zenoh/bytes", "application/msgpack", "", "text/plain"])
def test_garbage_is_reported_as_foreign(encoding: str) -> None:
    message = refused(OTHER_FIELDS, encoding)
    assert f"not {ENCODING}: it was not sent by sensor" in message


def test_a_bad_value_is_not_reported_as_a_version_conflict() -> None:
    tree = SOUND | {"arms": [ARM | {"valid": 1}]}
    assert refused(tree, ENCODING).endswith("neither true nor false")


@pytest.mark.parametrize("version", ["", "x", "9" * 5000, "²", "-1", "1.5", "\x1b[2J"])
def test_an_invalid_version_is_not_mentioned_in_the_error(version: str) -> None:
    message = refused(OTHER_FIELDS, ENCODING.replace(f"v{WIRE}", f"v{version}"))
    assert message.endswith("colour, t_s")
    assert message.isprintable()


def test_tokens_of_other_versions_are_found_and_foreign_ones_ignored() -> None:
    tokens = [
        live_key("demo", "sensor"),
        "pincette/v3/demo/live/controller",
        "pincette/v0/demo/live/estimator",
        "pincette/v/demo/live/actuator",
        "pincette/vx/demo/live/actuator",
        f"pincette/v{'9' * 5000}/demo/live/actuator",
        "other/v2/demo/live/actuator",
        "pincette/v2/live/actuator",
    ]
    assert of_other_wires(tokens) == {"controller": 3, "estimator": 0}
    assert of_other_wires(tokens[:1]) == {}
    assert live_key_of_any_wire("demo") == "pincette/*/demo/live/*"
