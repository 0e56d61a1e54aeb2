"""Which partners a program waits for, and why, in one log line."""

from pincette.engine.peers import absent


def test_every_missing_program_is_named() -> None:
    assert absent({"sensor", "actuator"}, {}, {}) == "actuator, sensor"


def test_a_missing_program_is_reported_with_its_known_cause() -> None:
    causes = {"actuator": "no program listens at tcp/127.0.0.1:7451", "sensor": ""}
    missing = absent({"sensor", "actuator"}, {}, causes)
    assert missing == "actuator (no program listens at tcp/127.0.0.1:7451), sensor"


def test_another_wire_version_is_reported_as_the_cause() -> None:
    missing = absent({"actuator"}, {"actuator": 7}, {"actuator": "no program listens"})
    assert "wire version 7" in missing
    assert "no program listens" not in missing


def test_a_program_that_has_appeared_meanwhile_is_not_named() -> None:
    assert absent({"sensor"}, {"actuator": 7}, {"actuator": "no program listens"}) == "sensor"
