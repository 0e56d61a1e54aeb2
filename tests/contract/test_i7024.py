"""The I-7024's driver: its bytes, and its handling of refusals."""

import re
from collections.abc import Callable

import pytest

from pincette.config import ConfigError, Output
from pincette.instruments import icpdas_i7024
from pincette.instruments.protocols import InstrumentError, Link

UNWATCHED = {"watchdog_s": 0.0}


def settings(url: str = "memory://", /, **options: str | float | bool) -> Output:
    return Output(driver="icpdas_i7024", url=url, timeout_s=0.5, options=dict(options))


class Lines:
    """A link that returns the module's name and configuration, and one fixed reply to all other
    requests."""

    def __init__(
        self, reply: bytes, name: bytes = b"!017024", configuration: bytes = b"!01330A00"
    ) -> None:
        self.reply = reply
        self.known = {b"$01M": name, b"$012": configuration}
        self.asked: list[bytes] = []
        self.closed = False

    def exchange(self, request: bytes) -> bytes:
        self.asked.append(request)
        return self.known.get(request, self.reply)

    def tell(self, line: bytes) -> None:
        self.asked.append(line)

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize(
    ("reply", "text", "cause"),
    [
        (b"?", "out of range", "refused"),
        (b"?01", "invalid command", "refused"),
        (b"!", "host watchdog has tripped", "tripped"),
        (b"!01", "is unknown", "garbled"),
    ],
)
def test_a_refusal_names_value_and_cause(reply: bytes, text: str, cause: str) -> None:
    output = icpdas_i7024.open_output(settings(**UNWATCHED), Lines(reply))
    with pytest.raises(InstrumentError, match=rf"-1\.500 V .*{text}") as caught:
        output.write_V(-1.5)
    assert caught.value.code == cause


def test_the_bytes_match_the_manual_of_the_instrument() -> None:
    link = Lines(b">")
    icpdas_i7024.open_output(settings(channel=2, **UNWATCHED), link).write_V(5.0)
    assert link.asked == [b"$01M", b"$012", b"#012+05.000"]


@pytest.mark.parametrize(
    ("configuration", "found"),
    [
        ("300A00", "0 to 20 mA"),
        ("310A00", "4 to 20 mA"),
        ("320A00", "0 to +10 V"),
        ("340A00", "0 to +5 V"),
        ("350A00", "-5 to +5 V"),
        ("3F0A00", "3F"),
        ("330A04", "slew rate code 1"),
        ("330A2C", "slew rate code 11"),
        ("330A44", "slew rate code 1"),
        ("330A01", "% of full scale"),
        ("330A02", "hexadecimal"),
        ("330A03", "03"),
    ],
)
def test_a_module_with_other_settings_is_refused_before_it_moves(
    configuration: str, found: str
) -> None:
    link = Lines(b">", configuration=b"!01" + configuration.encode())
    with pytest.raises(InstrumentError, match=re.escape(found)) as caught:
        icpdas_i7024.open_output(settings(**UNWATCHED), link)
    assert caught.value.code == "refused"
    assert link.asked == [b"$01M", b"$012"]
    assert link.closed


@pytest.mark.parametrize("configuration", ["330A00", "330600", "330A40", "33CA00"])
def test_line_speed_and_checksum_of_the_configuration_are_not_compared(configuration: str) -> None:
    link = Lines(b">", configuration=b"!01" + configuration.encode())
    icpdas_i7024.open_output(settings(**UNWATCHED), link).write_V(1.0)


def test_a_module_reconfigured_while_the_line_was_lost_is_refused() -> None:
    link = Lines(b">")
    prepared: list[Callable[[Link], None]] = []

    def connect(on_open: Callable[[Link], None]) -> Link:
        prepared.append(on_open)
        return link

    icpdas_i7024.I7024(icpdas_i7024.I7024Options(watchdog_s=0.0), connect)
    link.known[b"$012"] = b"!01310A00"
    with pytest.raises(InstrumentError, match="4 to 20 mA"):
        prepared[0](link)


def test_a_different_instrument_at_the_address_is_refused_at_opening() -> None:
    link = Lines(b">", name=b"MS,01")
    with pytest.raises(InstrumentError, match="name answered by b'MS,01'"):
        icpdas_i7024.open_output(settings(), link)
    assert link.closed


def test_a_wrong_checksum_is_refused() -> None:
    with pytest.raises(InstrumentError, match="wrong checksum") as caught:
        icpdas_i7024.open_output(settings(checksum=True), Lines(b">00", name=b"!01702400"))
    assert caught.value.code == "garbled"


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("address", 256),
        ("channel", 4),
        ("checksum", "yes"),
        ("baud", 300),
        ("colour", "red"),
        ("watchdog_s", 0.25),
        ("watchdog_s", 25.6),
        ("watchdog_s", -0.1),
    ],
)
def test_impossible_options_are_refused(option: str, value: str | float) -> None:
    with pytest.raises(ConfigError, match=f"icpdas_i7024 option {option} = {value!r}"):
        icpdas_i7024.open_output(settings(**{option: value}))


@pytest.mark.parametrize(
    ("baud", "checksum", "watchdog_s", "exchange_ms"),
    [
        (9600, False, 0.0, 14.6),
        (38400, False, 0.0, 3.6),
        (115200, False, 0.0, 1.2),
        (9600, False, 0.5, 18.8),
        (115200, False, 0.5, 1.6),
        (115200, True, 0.5, 2.1),
    ],
)
def test_the_duration_of_a_write_is_computed_from_the_line_settings(
    baud: int, checksum: bool, watchdog_s: float, exchange_ms: float
) -> None:
    chosen = settings(baud=baud, checksum=checksum, watchdog_s=watchdog_s)
    timing = icpdas_i7024.timing(chosen)
    assert round(1e3 * timing.exchange_s, 1) == exchange_ms
    assert timing.response_s == 0.010
    assert timing.buffered_hz is None
