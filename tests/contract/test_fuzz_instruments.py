"""Whatever bytes a line carries, a simulated instrument replies with bytes or nothing, and a driver
raises one type of exception; over memory, and fewer frames over a real pseudo-terminal. Seeded."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import pytest

from pincette.config import Output, Sensor
from pincette.instruments import icpdas_i7024, keyence_lkg, srs_dc205
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError, Link
from pincette.sim.instruments import dc205
from pincette.sim.instruments.dc205 import SimulatedDC205
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.protocol import TERMINATOR, Instrument
from pincette.sim.wires.wire import serve

SEED = 7024
FRAMES = 100_000
REPLIES = 100_000
ON_THE_LINE = 400
ALPHABET = b"0123456789ABCDEF+-.,;:?!>#$~* msrtgqkvlwxoienTGSM\t\x00\x7f\xff"

Action = Callable[[], object]


def keyence(chance: random.Random) -> Instrument:
    readings = (0.0, 1.5, -20_000.0, 20_000.0, None, float("nan"))
    return SimulatedKeyence(
        lambda: chance.choice(readings), unsolicited_every=3, mode_change_s=0.5, clock=chance.random
    )


def older_keyence(chance: random.Random) -> Instrument:
    return SimulatedKeyence(lambda: chance.uniform(-9.0, 9.0), "mm", dialect="LK-G3000")


def module(chance: random.Random) -> Instrument:
    return SimulatedI7024(_bounded(10.0), lambda: chance.uniform(0.0, 1.0))


def module_with_checksum(chance: random.Random) -> Instrument:
    return SimulatedI7024(_bounded(10.0), chance.random, address=0xAB, channel=3, checksum=True)


def source(_chance: random.Random) -> Instrument:
    return SimulatedDC205(_bounded(100.0))


def _bounded(limit_V: float) -> Callable[[float], None]:
    def put_out(voltage_V: float) -> None:
        assert isfinite(voltage_V)
        assert abs(voltage_V) <= limit_V

    return put_out


@dataclass(frozen=True)
class Subject:
    """An instrument, lines that it understands, and the calls of its driver over a link."""

    instrument: Callable[[random.Random], Instrument]
    lines: tuple[bytes, ...]
    acts: Callable[[Link], list[Action]]
    terminator: bytes = TERMINATOR


def sensor_acts(link: Link) -> list[Action]:
    settings = Sensor(
        driver="keyence_lkg", url="memory:", minimum_um=-9.0, maximum_um=9.0, noise_um=0.03
    )
    sensor = keyence_lkg.open_sensor(settings, link)
    return [sensor.read_um]


def output_acts(options: dict[str, str | int | float | bool]) -> Callable[[Link], list[Action]]:
    def acts(link: Link) -> list[Action]:
        settings = Output(driver="icpdas_i7024", url="memory:", options=options)
        output = icpdas_i7024.open_output(settings, link)
        return [
            lambda: output.write_V(1.0),
            output.read_V,
            output.keep_alive,
            output.clear_trip,
        ]

    return acts


def source_acts(link: Link) -> list[Action]:
    output = srs_dc205.open_output(Output(driver="srs_dc205", url="memory:"), link)
    return [lambda: output.write_V(1.0), output.read_V]


SUBJECTS = {
    "keyence": Subject(
        keyence,
        (
            b"MS,01", b"MM,110000000000", b"MA", b"R0", b"Q0", b"VR,1", b"KL,0", b"SW,CA,3",
            b"SW,OC,01,0,5", b"M1",
        ),
        sensor_acts,
    ),
    "older keyence": Subject(older_keyence, (b"M0", b"M1", b"M2", b"R0", b"Q0"), sensor_acts),
    "module": Subject(
        module,
        (
            b"#010+01.000", b"$01M", b"$0180", b"$0160", b"$0140", b"$012", b"$01F", b"~010",
            b"~011", b"~013105", b"~013000", b"~0150", b"~**",
        ),
        output_acts({}),
    ),
    "module with checksum": Subject(
        module_with_checksum,
        (b"#AB3+01.000F8", b"$ABMF4", b"~AB0D1", b"~**D2"),
        output_acts({"address": 0xAB, "channel": 3, "checksum": True}),
    ),
    "source": Subject(
        source,
        (
            b"TERM LF;*IDN?", b"VOLT 1.5;SOUT?;LEXE?;LCME?", b"VOLT?;SOUT?;OVLD?", b"SOUT 1",
            b"SOUT OFF", b"RNGE RANGE100", b"TOKN 0", b"VOLT 1e999",
        ),
        source_acts,
        dc205.TERMINATOR,
    ),
}  # fmt: skip


def spoilt(chance: random.Random, line: bytes, terminator: bytes) -> bytes:
    """Return one line with bytes changed, dropped or added, or something else entirely."""
    kind = chance.randrange(6)
    if kind == 0:
        line = chance.randbytes(chance.randrange(40))
    elif kind == 1:
        line = bytes(chance.choices(ALPHABET, k=chance.randrange(1, 300)))
    elif kind < 5:
        place = chance.randrange(len(line) + 1)
        byte = bytes(chance.choices(ALPHABET, k=1)) if kind < 4 else b""
        line = line[:place] + byte + line[place + (kind != 2) :]
    return line.replace(terminator, b"")


@pytest.mark.parametrize("name", SUBJECTS)
def test_an_instrument_survives_arbitrary_frames(name: str) -> None:
    subject, chance = SUBJECTS[name], random.Random(SEED)
    print(f"seed {SEED}")
    instrument = subject.instrument(chance)
    answered = 0
    for _ in range(FRAMES):
        line = spoilt(chance, chance.choice(subject.lines), subject.terminator)
        instrument.idle()
        reply = instrument.answer(line)
        assert reply is None or type(reply) is bytes, line
        answered += reply is not None
    assert 0.03 * FRAMES < answered < FRAMES


def misled(subject: Subject, chance: random.Random) -> Callable[[bytes], bytes | None]:
    """Return an instrument whose every other reply is corrupted or missing."""
    instrument = subject.instrument(chance)

    def answer(line: bytes) -> bytes | None:
        reply = instrument.answer(line)
        if chance.random() < 0.5:
            return reply
        if reply is None or chance.random() < 0.1:
            return None
        return spoilt(chance, reply, b"")

    return answer


def provoke(subject: Subject, chance: random.Random, link: Link, replies: int) -> dict[str, int]:
    """Make a driver process this many replies; returns the exceptions, counted by cause."""
    left: dict[str, int] = {}
    acts: list[Action] = []
    for _ in range(replies):
        try:
            if not acts or chance.random() < 0.02:
                acts = subject.acts(link)
            value = chance.choice(acts)()
        except InstrumentError as error:
            left[error.code] = left.get(error.code, 0) + 1
            continue
        assert value is None or (isinstance(value, float) and isfinite(value))
        left["none"] = left.get("none", 0) + 1
    return left


class Unclosed:
    """A link that a driver cannot close, so that the next driver can continue with it."""

    def __init__(self, link: Link) -> None:
        self.exchange, self.tell = link.exchange, link.tell

    def close(self) -> None:
        pass


@pytest.mark.parametrize("name", SUBJECTS)
def test_a_driver_raises_the_same_exception_type_for_any_invalid_answer(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keyence_lkg, "MODE_CHANGE_S", 0.0)
    subject, chance = SUBJECTS[name], random.Random(SEED)
    print(f"seed {SEED}")
    link = MemoryLink(misled(subject, chance), subject.terminator, keyence_lkg.solicited)
    left = provoke(subject, chance, Unclosed(link), REPLIES)
    print(left)
    assert sum(left.values()) == REPLIES
    assert {"silent", "garbled"} <= left.keys()
    assert not left.keys() & {"cannot_open", "hung_up"}


class Misled:
    """The same corrupted instrument, to be served on a port."""

    def __init__(self, subject: Subject, chance: random.Random) -> None:
        self._answer = misled(subject, chance)

    def answer(self, line: bytes) -> bytes | None:
        return self._answer(line)

    def idle(self) -> None:
        pass


@pytest.mark.parametrize("name", SUBJECTS)
def test_a_driver_on_a_line_raises_the_same_exception_type_for_any_invalid_answer(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keyence_lkg, "MODE_CHANGE_S", 0.0)
    subject, chance = SUBJECTS[name], random.Random(SEED)
    print(f"seed {SEED}")
    instrument = Misled(subject, random.Random(SEED + 1))
    with serve(str(tmp_path / "port"), instrument, terminator=subject.terminator) as wire:
        link = open_link(
            wire.url,
            baud=115200,
            timeout_s=0.02,
            terminator=subject.terminator,
            accept=keyence_lkg.solicited,
        )
        left = provoke(subject, chance, Unclosed(link), ON_THE_LINE)
        link.close()
    print(left)
    assert sum(left.values()) == ON_THE_LINE
    assert "silent" in left
    assert left.keys() & {"garbled", "refused", "late"}
    assert not left.keys() & {"cannot_open", "hung_up", "misused"}
