import pytest

from pincette.sim.instruments.dcon import SimulatedI7024


class Stage:
    """A clock that the test sets, and the output voltages."""

    def __init__(self, checksum: bool = False) -> None:
        self.now_s = 0.0
        self.voltages_V: list[float] = []
        self.module = SimulatedI7024(
            self.voltages_V.append, lambda: self.now_s, address=0x1A, checksum=checksum
        )


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"#1A0+05.000", b">"),
        (b"#1A0+10.000", b">"),
        (b"#1A0+10.001", b"?"),
        (b"#1A0-99.999", b"?"),
        (b"#1A0+5", b"?1A"),
        (b"#1A4+05.000", b"?1A"),
        (b"#1B0+05.000", None),
        (b"#1a0+05.000", None),
        (b"garbage", None),
        (b"", None),
        (b"$1AM", b"!1A7024"),
        (b"$1AF", b"!1AA1.0"),
        (b"$1A60", b"!1A+00.000"),
        (b"$1A80", b"!1A+00.000"),
        (b"$1A40", b"!1A"),
        (b"$1AZ", b"?1A"),
        (b"~1A0", b"!1A00"),
        (b"~1A1", b"!1A"),
        (b"~**", None),
    ],
)
def test_a_module_answers_in_its_initial_state(line: bytes, reply: bytes | None) -> None:
    assert Stage().module.answer(line) == reply


def test_the_configuration_names_type_speed_and_format() -> None:
    reply = Stage().module.answer(b"$1A2")
    assert reply is not None
    assert len(reply) == 9
    assert reply.startswith(b"!1A")


def test_only_the_configured_channel_drives_the_plant() -> None:
    stage = Stage()
    stage.module.answer(b"#1A0-01.250")
    stage.module.answer(b"#1A2+03.000")
    assert stage.voltages_V == [-1.25]
    assert stage.module.answer(b"$1A62") == b"!1A+03.000"


def test_the_host_watchdog_trips_to_the_safe_value_and_latches() -> None:
    stage = Stage()
    ask = stage.module.answer
    assert [ask(line) for line in (b"#1A0+00.500", b"~1A50", b"#1A0+02.000")] == [
        b">",
        b"!1A",
        b">",
    ]
    assert ask(b"~1A3105") == b"!1A"
    stage.now_s = 0.4
    ask(b"~**")
    stage.now_s = 0.8
    stage.module.idle()
    assert stage.voltages_V == [0.5, 2.0]
    stage.now_s = 0.95
    stage.module.idle()
    assert stage.voltages_V == [0.5, 2.0, 0.5]
    assert ask(b"#1A0+01.000") == b"!"
    assert ask(b"~1A0") == b"!1A04"
    assert ask(b"$1A60") == b"!1A+02.000"
    assert ask(b"$1A80") == b"!1A+00.500"
    assert ask(b"~1A1") == b"!1A"
    assert ask(b"#1A0+01.000") == b">"
    assert stage.voltages_V == [0.5, 2.0, 0.5, 1.0]


def test_a_power_cycle_starts_at_the_power_on_value_without_trip_or_watchdog() -> None:
    stage = Stage()
    ask = stage.module.answer
    ask(b"#1A0+00.250")
    assert ask(b"$1A40") == b"!1A"
    ask(b"#1A0+03.000")
    ask(b"~1A3101")
    stage.now_s = 0.2
    assert ask(b"#1A0+01.000") == b"!"
    assert stage.module.tripped
    stage.module.power_cycle()
    assert not stage.module.tripped
    assert stage.voltages_V == [0.25, 3.0, 0.0, 0.25]
    assert ask(b"~1A0") == b"!1A00"
    assert ask(b"$1A60") == b"!1A+00.250"
    stage.now_s = 9.0
    assert ask(b"#1A0+01.000") == b">"


@pytest.mark.parametrize(
    ("line", "reply"),
    [(b"~1A3100", b"?1A"), (b"~1A3000", b"!1A"), (b"~1A32FF", b"?1A"), (b"~1A31FF", b"!1A")],
)
def test_a_watchdog_needs_a_time(line: bytes, reply: bytes) -> None:
    assert Stage().module.answer(line) == reply


def test_a_watchdog_that_is_switched_off_does_not_trip() -> None:
    stage = Stage()
    stage.module.answer(b"~1A3101")
    stage.module.answer(b"~1A3001")
    stage.now_s = 9.0
    stage.module.idle()
    assert stage.voltages_V == []
    assert stage.module.answer(b"~1A0") == b"!1A00"


def test_a_heartbeat_carries_the_checksum_too() -> None:
    stage = Stage(checksum=True)
    # The bytes of ~1A3102 add up to 0x7E + 0x31 + 0x41 + 0x33 + 0x31 + 0x30 + 0x32 = 0x1B6.
    assert stage.module.answer(b"~1A3102B6") is not None
    stage.now_s = 0.15
    assert stage.module.answer(b"~**D2") is None
    stage.now_s = 0.3
    stage.module.idle()
    assert not stage.module.tripped
    assert stage.module.answer(b"~**") is None
    stage.now_s = 0.36
    stage.module.idle()
    assert stage.module.tripped


def test_a_checksum_is_required_and_sent() -> None:
    stage = Stage(checksum=True)
    # The bytes of $1AM add up to 0x24 + 0x31 + 0x41 + 0x4D = 0xE3.
    assert stage.module.answer(b"$1AM") is None
    assert stage.module.answer(b"$1AME4") is None
    reply = stage.module.answer(b"$1AME3")
    assert reply is not None
    assert reply[:-2] == b"!1A7024"
    assert int(reply[-2:], 16) == (0x21 + 0x31 + 0x41 + 0x37 + 0x30 + 0x32 + 0x34) % 256
