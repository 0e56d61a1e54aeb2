"""Device servers in unwanted configurations.

The fault is reported by a code and a remedy, no wrong value is accepted, and the line recovers.
"""

import os
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import closing, contextmanager, suppress
from itertools import count, pairwise
from pathlib import Path
from threading import Event, Thread

import pytest

from pincette.core.service import SetVoltage
from pincette.diagnostics import Finding
from pincette.diagnostics.instruments import instruments, opened_device
from pincette.engine.instrument import Instrument, ReadingWatch
from pincette.engine.process import loop_services
from pincette.instruments import icpdas_i7024, keyence_lkg
from pincette.instruments.line import exclusive, serial_link
from pincette.instruments.line.counts import LineCounts, counting
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.wires.wire import Wire, serve
from tests.contract.test_device_servers import X_UM, laser, open_sensor, refusal
from tests.contract.test_late_answers import output_settings
from tests.support.device_servers import program, ser2net
from tests.support.rigs import demo_rig, free_ports

__all__ = ["laser"]

RECOVERS_S = 10.0
REPLACED = 2
"""Number of times that a client is replaced."""


def recovered_um(sensor: keyence_lkg.KeyenceLKG) -> float:
    """Return the first reading that succeeds within ``RECOVERS_S``."""
    until_s = time.monotonic() + RECOVERS_S
    while time.monotonic() < until_s:
        with suppress(InstrumentError):
            return sensor.read_um()
        time.sleep(0.02)  # a real server: request about as often as the loop does
    return sensor.read_um()


def hung_up(sensor: keyence_lkg.KeyenceLKG) -> str:
    with pytest.raises(InstrumentError) as caught:
        sensor.read_um()
    assert caught.value.code == "hung_up"
    return str(caught.value)


def connect(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port))


def finding(url: str) -> Finding:
    """Return what doctor reports about a sensor that does not open."""
    found = opened_device(
        loop_services()["sensor"], demo_rig({"sensor": {"url": url, "timeout_s": 1.0}})
    )
    assert isinstance(found, Finding)
    return found


def test_a_sensor_is_read_over_ipv6(laser: Wire, tmp_path: Path) -> None:
    with (
        ser2net(laser.url, tmp_path, host="::1") as server,
        closing(open_sensor(server.url)) as sensor,
    ):
        assert sensor.read_um() == pytest.approx(X_UM)


def test_a_udp_port_is_refused_with_a_hint(laser: Wire, tmp_path: Path) -> None:
    with ser2net(laser.url, tmp_path, accepter="udp") as server:
        assert "TCP port" in str(refusal(server.url))


def test_doctor_reports_that_a_tls_port_must_be_raw(laser: Wire, tmp_path: Path) -> None:
    openssl = ["req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=server"]
    files = ["-keyout", "key.pem", "-out", "certificate.pem"]
    subprocess.run(
        [program("openssl"), *openssl, *files], cwd=tmp_path, check=True, capture_output=True
    )
    accepter = f"ssl(key={tmp_path}/key.pem,cert={tmp_path}/certificate.pem),tcp"
    with ser2net(laser.url, tmp_path, accepter=accepter) as server:
        found = finding(server.url)
    assert "without TLS" in found.remedy


@pytest.mark.parametrize(
    ("accepter", "device", "cause"),
    [
        ("tcp", "absent", "Device open failure"),
        ("telnet,tcp", "tty", "telnet port"),
    ],
)
def test_doctor_does_not_suspect_the_cable_if_the_server_states_the_cause(
    accepter: str, device: str, cause: str, laser: Wire, tmp_path: Path
) -> None:
    assert laser.url == str(tmp_path / "tty")
    with ser2net(str(tmp_path / device), tmp_path, accepter=accepter) as server:
        found = finding(server.url)
    assert cause in found.what
    assert "cable" not in found.remedy


def test_doctor_does_not_suspect_the_cable_of_a_port_in_use(laser: Wire, tmp_path: Path) -> None:
    with ser2net(laser.url, tmp_path) as server, connect(server.port):
        found = finding(server.url)
    assert "Port already in use" in found.what
    assert "cable" not in found.remedy


def test_doctor_does_not_suspect_the_cable_of_a_host_name_or_a_port_without_a_server() -> None:
    for url in ("socket://laser.invalid:4001", f"socket://127.0.0.1:{free_ports(1)}"):
        assert "cable" not in finding(url).remedy


def test_doctor_suspects_the_baud_rate_of_a_server_behind_which_nothing_answers(
    tmp_path: Path,
) -> None:
    """An instrument that is sent bytes at another baud rate stays silent."""
    silent = serve(str(tmp_path / "tty"), SimulatedKeyence(lambda: X_UM), terminator=b"\x00")
    with silent as wire, ser2net(wire.url, tmp_path) as server:
        found = finding(server.url)
    assert "baud" in found.remedy


def test_doctor_names_the_laser_at_the_address_of_the_output() -> None:
    with serve("socket://127.0.0.1:0", SimulatedKeyence(lambda: X_UM)) as wire:
        changes = {"output": {"url": wire.url, "timeout_s": 0.5}}
        found = opened_device(loop_services()["actuator"], demo_rig(changes))
    assert isinstance(found, Finding)
    assert "Keyence laser answers" in found.remedy
    assert "exchanged" in found.remedy


@pytest.mark.parametrize(
    ("url", "remedy"),
    [
        ("socket://laser.invalid:4001", "host name does not resolve"),
        ("127.0.0.1:4001", "write socket://127.0.0.1:4001"),
        ("tcp://127.0.0.1:4001", "write socket://127.0.0.1:4001"),
        ("telnet://laser:4001", "write socket://laser:4001"),
        ("socket:laser:4001", "write socket://laser:4001"),
        ("socket:/laser:4001", "write socket://laser:4001"),
        ("socket://[fe80::1]:4001", "network interface"),
    ],
)
def test_an_unusable_url_is_answered_with_a_valid_form(url: str, remedy: str) -> None:
    with pytest.raises(InstrumentError, match=remedy) as caught:
        open_link(url, baud=9600, timeout_s=0.2)
    assert caught.value.code == "cannot_open"


@contextmanager
def answering(*, banner: bytes = b"", before: bytes = b"", resets: bool = False) -> Generator[str]:
    """Serve one client of a simulated laser; ``before``: bytes that precede each of its replies."""
    instrument = SimulatedKeyence(lambda: X_UM)

    def serve_one() -> None:
        peer, _ = listener.accept()
        with peer, suppress(OSError):
            if resets:
                peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                return
            peer.sendall(banner)
            while request := peer.recv(64):
                answer = instrument.answer(request.rstrip(b"\r")) or b""
                peer.sendall(before + answer + b"\r")

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = Thread(target=serve_one, daemon=True)
        thread.start()
        yield f"socket://127.0.0.1:{listener.getsockname()[1]}"
        thread.join(10.0)
    assert not thread.is_alive()


def test_a_banner_in_utf_16_is_not_mistaken_for_a_telnet_command() -> None:
    with (
        answering(banner="Gerät läuft\r\n".encode("utf-16")) as url,
        closing(open_sensor(url)) as sensor,
    ):
        assert sensor.read_um() == pytest.approx(X_UM)


def test_telnet_commands_between_answers_are_reported() -> None:
    with answering(before=b"\xff\xf1") as url:
        assert "telnet port" in str(refusal(url))


def test_a_connection_that_is_reset_at_once_is_named() -> None:
    with answering(resets=True) as url:
        error = refusal(url)
    assert error.code == "cannot_open"
    assert "has another client taken the port" in str(error)


def test_a_missing_name_server_does_not_delay_a_reopened_line(
    laser: Wire, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    resolve = socket.getaddrinfo

    def numeric_only(host: str, *more: object, **named: object) -> object:
        if host == "localhost":
            time.sleep(RECOVERS_S)  # a name server that is missing keeps its caller waiting
        # The arguments are passed on unchanged.
        return resolve(host, *more, **named)  # type: ignore[arg-type]

    options = "kickolduser: true"
    with (
        ser2net(laser.url, tmp_path, options=options) as server,
        closing(open_sensor(f"socket://localhost:{server.port}")) as sensor,
    ):
        monkeypatch.setattr(socket, "getaddrinfo", numeric_only)
        connect(server.port).close()
        hung_up(sensor)
        began_s = time.monotonic()
        assert recovered_um(sensor) == pytest.approx(X_UM)
        assert time.monotonic() - began_s < RECOVERS_S


def test_a_client_that_a_server_replaces_reconnects_and_suspects_a_second_program(
    laser: Wire, tmp_path: Path
) -> None:
    with (
        ser2net(laser.url, tmp_path, options="kickolduser: true") as server,
        closing(open_sensor(server.url)) as sensor,
    ):
        text = ""
        for _ in range(serial_link.OFTEN + 1):
            with connect(server.port):
                time.sleep(serial_link.RETRY_S)  # a real server: the line tries no more often
                text = hung_up(sensor)
                assert recovered_um(sensor) == pytest.approx(X_UM)
        assert "another program use this port" in text


def test_an_idle_timeout_of_the_server_does_not_prevent_an_arming(tmp_path: Path) -> None:
    """An output without a watchdog is not written to between jobs."""
    module = SimulatedI7024(lambda _voltage_V: None, time.monotonic)
    with (
        serve(str(tmp_path / "tty"), module) as wire,
        ser2net(wire.url, tmp_path, more="timeout: 1") as server,
    ):
        settings = output_settings("icpdas_i7024", 1.0, watchdog_s=0.0)
        counts = LineCounts()
        with counting(counts):
            output = icpdas_i7024.open_output(settings.model_copy(update={"url": server.url}))
        instrument = Instrument(output, 0.02, None, counts)
        with closing(instrument):
            assert instrument.put_out(SetVoltage((1.0,))) is None
            while is_connected(server.port):
                time.sleep(0.1)  # the server has no event for the end of a client
            assert instrument.read_back() == pytest.approx(1.0)
        assert counts.reopened == 1


@pytest.mark.usefixtures("stalls")
@pytest.mark.parametrize("watchdog_s", [0.0, 0.5])
def test_an_output_whose_client_is_replaced_keeps_working(
    watchdog_s: float, tmp_path: Path
) -> None:
    """The second client disconnects at once, as after a brief use of a terminal program."""
    put_V: list[float] = []
    module = SimulatedI7024(put_V.append, time.monotonic)
    with (
        serve(str(tmp_path / "tty"), module) as wire,
        ser2net(wire.url, tmp_path, options="kickolduser: true\nchardelay: false") as server,
    ):
        settings = output_settings("icpdas_i7024", 0.1, watchdog_s=watchdog_s)
        counts = LineCounts()
        with counting(counts):
            output = icpdas_i7024.open_output(settings.model_copy(update={"url": server.url}))
        # The period is long enough for a busy machine; the time taken is printed.
        instrument = Instrument(output, 1.0, ReadingWatch(1.0), counts)
        took_s: list[float] = []
        with closing(instrument):
            for number in range(REPLACED):
                # the line retries at most this often
                until_s = time.monotonic() + serial_link.RETRY_S
                end_s = until_s + RECOVERS_S
                while counts.retried <= number:
                    began_s = time.monotonic()
                    assert instrument.put_out(SetVoltage((1.0 + 0.01 * number,))) is None
                    now_s = time.monotonic()
                    if counts.retried > number:
                        took_s.append(now_s - began_s)
                    if until_s <= began_s:
                        connect(server.port).close()
                        until_s = float("inf")
                    assert began_s < end_s
                    time.sleep(0.02)  # a write each period, as the loop does to a real server
            last_V = 1.0 + 0.01 * (REPLACED - 1)
            assert instrument.read_back() == pytest.approx(last_V, abs=0.002)
        assert counts.reopened == counts.retried == REPLACED
        print(f"a lost line: written again after {[f'{1e3 * one:.1f}' for one in took_s]} ms")
    assert min(put_V) >= 1.0 - 0.002


def is_connected(port: int) -> bool:
    """Return whether a server has an established connection at a port."""
    rows = Path("/proc/net/tcp").read_text("ascii").splitlines()[1:]
    return any(row.split()[1].endswith(f":{port:04X}") and row.split()[3] == "01" for row in rows)


@contextmanager
def second_client(port: int) -> Generator[None]:
    """Request readings continuously, as a second program does."""
    ended = Event()

    def ask() -> None:
        with connect(port) as client:
            while not ended.wait(0.005):
                client.sendall(b"MS,01\r")
                client.recv(4096)

    thread = Thread(target=ask)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@pytest.mark.usefixtures("stalls")
def test_with_a_second_client_readings_stay_current_and_doctor_suspects_that_client(
    tmp_path: Path,
) -> None:
    """The server passes every reply on to both clients; each reply is larger than the last."""
    numbers = count()
    simulated = SimulatedKeyence(lambda: 0.01 * next(numbers))
    module = SimulatedI7024(lambda _voltage_V: None, time.monotonic)
    with (
        serve(str(tmp_path / "tty"), simulated) as wire,
        serve("socket://127.0.0.1:0", module) as output,
        ser2net(wire.url, tmp_path, options="max-connections: 2") as server,
        second_client(server.port),
    ):
        values_um = [-1.0]
        with closing(open_sensor(server.url)) as sensor:
            for _ in range(50):
                with suppress(InstrumentError):  # The message of a line that was left silent.
                    values_um.append(sensor.read_um())
        rig = demo_rig({"sensor": {"url": server.url}, "output": {"url": output.url}})
        found = list(instruments(rig))
    assert len(values_um) > 1
    assert all(before < after for before, after in pairwise(values_um))
    assert any("max-connections" in one.remedy for one in found), found


def test_each_fault_states_why_a_line_does_not_return(laser: Wire, tmp_path: Path) -> None:
    with ser2net(laser.url, tmp_path) as server:
        sensor = open_sensor(server.url)
        server.kill()
    with closing(sensor), ser2net(laser.url, tmp_path, port=server.port) as again:
        with connect(again.port):
            time.sleep(serial_link.RETRY_S)  # a real server: the line tries no more often
            texts = [hung_up(sensor) for _ in range(5)]
            assert all("Port already in use" in text for text in texts[1:]), texts
        assert recovered_um(sensor) == pytest.approx(X_UM)


def test_a_device_that_returns_under_another_name_is_found_by_its_link(tmp_path: Path) -> None:
    link = tmp_path / "usb-laser-port0"
    with serve(str(tmp_path / "ttyUSB0"), SimulatedKeyence(lambda: X_UM)):
        link.symlink_to(tmp_path / "ttyUSB0")
        sensor = open_sensor(str(link))
    with closing(sensor):
        hung_up(sensor)
        with serve(str(tmp_path / "ttyUSB1"), SimulatedKeyence(lambda: X_UM + 1.0)):
            link.unlink()
            link.symlink_to(tmp_path / "ttyUSB1")
            assert recovered_um(sensor) == pytest.approx(X_UM + 1.0)


@pytest.fixture
def locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "lock"
    folder.mkdir()
    monkeypatch.setattr(exclusive, "UUCP_LOCKS", folder)
    return folder


def lock_file(locks: Path, device: str) -> Path:
    return locks / f"LCK..{device.replace('/', '_')}"


@pytest.mark.parametrize("content", ["{pid:>10}\n", "{pid:05d} minicom root\n", "{pid}", "number"])
def test_a_lock_of_a_live_program_is_respected_and_its_file_is_named(
    content: str, laser: Wire, locks: Path
) -> None:
    pid = os.getppid()
    file = lock_file(locks, laser.url)
    as_number = pid.to_bytes(4, sys.byteorder)
    file.write_bytes(as_number if content == "number" else content.format(pid=pid).encode())
    error = refusal(laser.url)
    assert error.code == "cannot_open"
    assert str(file) in str(error)
    assert file.exists()


@pytest.mark.parametrize(
    "content", [b"     99999999\n", b"99999999 minicom root\n", b"", b"no number", b"-1\n", b"0\n"]
)
def test_a_lock_of_a_dead_program_is_replaced(content: bytes, laser: Wire, locks: Path) -> None:
    file = lock_file(locks, laser.url)
    file.write_bytes(content)
    with closing(open_sensor(laser.url)) as sensor:
        assert int(file.read_bytes()) == os.getpid()
        assert sensor.read_um() == pytest.approx(X_UM)
    assert not file.exists()


def test_a_missing_lock_folder_does_not_prevent_an_instrument_from_working(
    laser: Wire, locks: Path
) -> None:
    locks.rmdir()
    with closing(open_sensor(laser.url)) as sensor:
        assert sensor.read_um() == pytest.approx(X_UM)


def test_a_pipe_instead_of_a_lock_file_does_not_block_a_program(laser: Wire, locks: Path) -> None:
    os.mkfifo(lock_file(locks, laser.url))
    with closing(open_sensor(laser.url)) as sensor:
        assert sensor.read_um() == pytest.approx(X_UM)


@pytest.mark.parametrize("other", ["localhost", "[::ffff:127.0.0.1]"])
def test_one_server_under_two_names_is_opened_once(other: str, laser: Wire, tmp_path: Path) -> None:
    with (
        ser2net(laser.url, tmp_path, options="max-connections: 2") as server,
        closing(open_sensor(server.url)),
    ):
        error = refusal(f"socket://{other}:{server.port}")
        assert error.code == "cannot_open"
        assert f"process {os.getpid()} " in str(error)
