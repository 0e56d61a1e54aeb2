"""Exchanges with an instrument can be recorded, read by a person, and replayed."""

from itertools import count
from pathlib import Path

import pytest

from pincette.config import Output, Sensor
from pincette.instruments import icpdas_i7024, keyence_lkg
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.line.recording import HEAD, Recorder, RecordingLink
from pincette.instruments.line.replay import ReplayLink
from pincette.instruments.line.serial_link import RETRY_S
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError, Link
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.wires.wire import serve

ANY = "socket://127.0.0.1:0"


def nothing(_link: Link) -> None:
    pass


def replay(path: Path) -> ReplayLink:
    return ReplayLink(f"replay:{path}", nothing)


def failure(link: Link, request: bytes) -> InstrumentError:
    with pytest.raises(InstrumentError) as caught:
        link.exchange(request)
    return caught.value


def written(path: Path, *lines: str) -> Path:
    path.write_text("".join(f"{line}\n" for line in (HEAD, *lines)), encoding="ascii")
    return path


def sensor(url: str, record: Path | None = None) -> Sensor:
    return Sensor(
        driver="keyence_lkg",
        url=url,
        minimum_um=-9999.0,
        maximum_um=9999.0,
        noise_um=0.03,
        timeout_s=1.0,
        record=str(record) if record else None,
    )


def test_a_recording_has_one_readable_line_per_exchange(tmp_path: Path) -> None:
    replies = iter([b"!01", b"!garbled", b"a\tb\\\xff\n", b"", None, None])
    times_s = count()
    path = tmp_path / "dialogue.txt"
    recorder = Recorder(path, "memory://", b"\r", lambda: 0.5 * next(times_s))
    link = RecordingLink(MemoryLink(lambda _line: next(replies)), recorder)
    for request in (b"$01M", b"!open", b"c", b"d"):
        link.exchange(request)
    assert failure(link, b"e").code == "silent"
    link.tell(b"~**")
    assert path.read_text(encoding="ascii").splitlines() == [
        "# pincette dialogue 1",
        "# url: memory://",
        r"# terminator: \r",
        "0.500000\t$01M\t!01",
        "1.000000\t\\x21open\t\\x21garbled",
        "1.500000\tc\ta\\tb\\\\\\xff\\n",
        "2.000000\td\t",
        "2.500000\te\t!silent memory: no answer to b'e'; check the address",
        "3.000000\t~**",
    ]
    link.close()


def test_a_recording_is_replayed(tmp_path: Path) -> None:
    replies = iter([b"!01", b"!garbled", b"a\tb\\\xff\n", b"", None, None])
    path = tmp_path / "dialogue.txt"
    recorder = Recorder(path, "memory://", b"\r", lambda: 0.0)
    link = RecordingLink(MemoryLink(lambda _line: next(replies), b"\x00"), recorder)
    requests = (b"$01M", b"!open", b"\x00", b"")
    answers = [link.exchange(request) for request in requests]
    assert answers == [b"!01", b"!garbled", b"a\tb\\\xff\n", b""]
    original = failure(link, b"e")
    link.tell(b"!told")
    played = replay(path)
    assert [played.exchange(request) for request in requests] == answers
    again = failure(played, b"e")
    assert (again.code, str(again)) == (original.code, str(original))
    assert not played.ended
    played.tell(b"!told")
    assert played.ended
    assert failure(played, b"f").code == "silent"
    played.close()
    link.close()
    assert failure(played, b"f").code == "misused"


def test_a_driver_plays_its_recording_without_a_change(tmp_path: Path) -> None:
    path = tmp_path / "dialogue.txt"
    # the first value is read when the port is opened
    positions_um = iter([0.0, 1.0, 20_000.0, None, 2.5])

    def all_said(settings: Sensor) -> list[float | str]:
        device = keyence_lkg.open_sensor(settings)
        received = list[float | str]()
        for _ in range(4):
            try:
                received.append(device.read_um())
            except InstrumentError as error:
                received.append(error.code)
        device.close()
        return received

    with serve(ANY, SimulatedKeyence(lambda: next(positions_um))) as wire:
        live = all_said(sensor(wire.url, path))
    assert live == [1.0, "out_of_range", "invalid", 2.5]
    assert all_said(sensor(f"replay:{path}")) == live


def test_a_deviation_from_the_recording_is_reported_with_its_line(tmp_path: Path) -> None:
    path = written(tmp_path / "d.txt", "# url: x", "0.1\tR0\tER,R0,01", "0.2\t~**")
    link = replay(path)
    error = failure(link, b"MS,01")
    assert error.code == "misused"
    assert f"{path}, line 3: b'MS,01' asked, recorded b'R0'" in str(error)
    assert link.exchange(b"R0") == b"ER,R0,01"
    assert "line 4: b'~**' needs an answer" in str(failure(link, b"~**"))
    link.tell(b"~**")


def test_a_line_recorded_without_an_answer_must_be_replayed_without_one(tmp_path: Path) -> None:
    link = replay(written(tmp_path / "d.txt", "0.1\tR0\tER,R0,01"))
    with pytest.raises(InstrumentError, match="line 2: b'R0' needs no answer") as caught:
        link.tell(b"R0")
    assert caught.value.code == "misused"


@pytest.mark.parametrize(
    "line",
    [
        "R0\tR0",
        "0.1",
        "0.1\ta\tb\tc",
        "0.1\ta\t!lost it",
        "0.1\t!shut",
        "0.1\ta\t\\u1234",
        "0.1\t\\",
    ],
)
def test_a_line_that_is_invalid_is_named(tmp_path: Path, line: str) -> None:
    path = written(tmp_path / "d.txt", "0.1\tR0\tR0", line)
    with pytest.raises(InstrumentError, match=r"d\.txt, line 3: ") as caught:
        replay(path)
    assert caught.value.code == "cannot_open"


@pytest.mark.parametrize("text", [None, "", "hello\n", "# pincette dialogue 2\n", "\xff"])
def test_an_invalid_recording_is_not_opened(tmp_path: Path, text: str | None) -> None:
    path = tmp_path / "d.txt"
    if text is not None:
        path.write_text(text, encoding="latin-1")
    with pytest.raises(InstrumentError, match="recording") as caught:
        open_link(f"replay:{path}", baud=9600, timeout_s=1.0)
    assert caught.value.code == "cannot_open"


def test_a_file_that_is_not_a_recording_is_not_overwritten(tmp_path: Path) -> None:
    kept = tmp_path / "rig.toml"
    kept.write_text("kept", encoding="ascii")
    with serve(ANY, SimulatedKeyence(lambda: 1.0)) as wire:
        for path in (kept, tmp_path / "nowhere" / "d.txt", tmp_path):
            with pytest.raises(InstrumentError) as caught:
                open_link(wire.url, baud=9600, timeout_s=1.0, record=path)
            assert caught.value.code == "cannot_open"
            assert str(path) in str(caught.value)
    assert kept.read_text(encoding="ascii") == "kept"


def test_a_reopened_port_replays_the_preparation_of_the_instrument(tmp_path: Path) -> None:
    path = tmp_path / "dialogue.txt"
    now_s = 0.0
    prepared = list[bytes]()

    def prepare(link: Link) -> None:
        prepared.append(link.exchange(b"R0"))
        if len(prepared) == 1:
            raise InstrumentError("not yet", "refused")

    wire = serve(ANY, SimulatedKeyence(lambda: 1.0))
    url = wire.url
    link = open_link(
        url, baud=9600, timeout_s=1.0, on_open=prepare, record=path, clock=lambda: now_s
    )
    try:
        answers = [link.exchange(b"MS,01")]
        wire.close()
        causes = [failure(link, b"MS,01").code]
        wire = serve(url, SimulatedKeyence(lambda: 2.0))
        causes += [failure(link, b"MS,01").code, failure(link, b"MS,01").code]
        now_s = RETRY_S
        answers.append(link.exchange(b"MS,01"))
    finally:
        link.close()
        wire.close()
    assert causes == ["hung_up", "refused", "hung_up"]
    assert answers == [b"MS,01,+0001.00", b"MS,01,+0002.00"]
    assert prepared == [b"ER,R0,01", b"ER,R0,01"]
    prepared.clear()
    played = ReplayLink(f"replay:{path}", prepare)
    assert played.exchange(b"MS,01") == answers[0]
    assert [failure(played, b"MS,01").code for _ in causes] == causes
    assert played.exchange(b"MS,01") == answers[1]
    assert prepared == [b"ER,R0,01", b"ER,R0,01"]
    assert played.ended


def test_an_output_records_its_watchdog_too(tmp_path: Path) -> None:
    path = tmp_path / "dialogue.txt"
    with serve(ANY, SimulatedI7024(lambda _voltage_V: None, lambda: 0.0)) as wire:
        for url, record in ((wire.url, str(path)), (f"replay:{path}", None)):
            settings = Output(driver="icpdas_i7024", url=url, record=record, timeout_s=1.0)
            output = icpdas_i7024.open_output(settings)
            output.keep_alive()
            output.write_V(1.25)
            output.close()
    text = path.read_text(encoding="ascii")
    assert "\t~**\n" in text
    assert text.endswith("\t~013005\t!01\n")
