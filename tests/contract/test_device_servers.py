"""A line behind a device server: banners, telnet, a second client, a missing device, restarts.

Real ser2net and socat in front of a simulated laser.
"""

import socket
import time
from collections.abc import Generator
from contextlib import closing
from pathlib import Path
from statistics import median
from threading import Thread

import pytest

from pincette.config import ConfigError
from pincette.instruments import keyence_lkg
from pincette.instruments.line import serial_link
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError, Link
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.wires.wire import Wire, serve
from tests.contract.test_late_answers import sensor_settings
from tests.support.device_servers import ser2net, socat
from tests.support.rigs import demo_rig

X_UM = 12.34


@pytest.fixture
def laser(tmp_path: Path) -> Generator[Wire]:
    with serve(str(tmp_path / "tty"), SimulatedKeyence(lambda: X_UM)) as wire:
        yield wire


def open_sensor(url: str, timeout_s: float = 1.0) -> keyence_lkg.KeyenceLKG:
    settings = sensor_settings("keyence_lkg", timeout_s).model_copy(update={"url": url})
    return keyence_lkg.open_sensor(settings)


def refusal(url: str) -> InstrumentError:
    with pytest.raises(InstrumentError) as caught:
        open_sensor(url)
    return caught.value


@pytest.mark.parametrize("banner", [r"MS,01,+0099.00\\r", r"login: "])
def test_a_banner_is_not_accepted_as_an_answer(banner: str, laser: Wire, tmp_path: Path) -> None:
    with (
        ser2net(laser.url, tmp_path, options=f"banner: '{banner}'") as server,
        closing(open_sensor(server.url)) as sensor,
    ):
        assert sensor.read_um() == pytest.approx(X_UM)


@pytest.mark.parametrize("accepter", ["telnet(rfc2217),tcp"])
def test_a_telnet_port_is_reported_as_such(accepter: str, laser: Wire, tmp_path: Path) -> None:
    with ser2net(laser.url, tmp_path, accepter=accepter) as server:
        error = refusal(server.url)
        assert error.code == "cannot_open"
        assert "telnet" in str(error)


def test_a_refusal_by_a_server_with_another_client_quotes_the_server(
    laser: Wire, tmp_path: Path
) -> None:
    with ser2net(laser.url, tmp_path) as server:
        with socket.create_connection(("127.0.0.1", server.port)):
            error = refusal(server.url)
            assert error.code == "cannot_open"
            assert "Port already in use" in str(error)
            assert "kickolduser" in str(error)
        closing_s = time.monotonic() + 10.0
        while time.monotonic() < closing_s:  # until the server has noticed
            try:
                open_sensor(server.url).close()
                return
            except InstrumentError:
                time.sleep(0.05)
        pytest.fail("the port was not free again")


def test_a_missing_device_is_named(tmp_path: Path) -> None:
    with ser2net(str(tmp_path / "absent"), tmp_path) as server:
        error = refusal(server.url)
        assert error.code == "cannot_open"
        assert "Device open failure" in str(error)


def test_a_port_opened_locally_and_over_a_server_cannot_be_used_at_the_same_time(
    laser: Wire, tmp_path: Path
) -> None:
    with ser2net(laser.url, tmp_path) as server:
        with closing(open_sensor(laser.url)):
            assert refusal(server.url).code == "cannot_open"
        with closing(open_sensor(server.url)):
            error = refusal(laser.url)
            assert error.code == "cannot_open"
            assert f"process {server.process.pid} " in str(error)


def test_a_server_that_restarts_is_found_again(laser: Wire, tmp_path: Path) -> None:
    with ser2net(laser.url, tmp_path) as server:
        sensor = open_sensor(server.url)
        server.kill()
        with pytest.raises(InstrumentError) as caught:
            sensor.read_um()
        assert caught.value.code == "hung_up"
    with ser2net(laser.url, tmp_path, port=server.port), closing(sensor):
        time.sleep(serial_link.RETRY_S)  # real servers: the line retries after this time
        assert sensor.read_um() == pytest.approx(X_UM)


def test_an_answer_to_an_earlier_client_is_not_accepted(laser: Wire) -> None:
    """After a reconnect the first line is a reading that another client requested."""
    stale = b"MS,01,+0099.00\r"
    with socket.create_server(("127.0.0.1", 0)) as listener:
        peers: list[socket.socket] = []

        def relay() -> None:
            for number in range(2):
                peer, _ = listener.accept()
                peers.append(peer)
                with closing(open_link(laser.url, baud=115200, timeout_s=1.0)) as behind:
                    if number:
                        peer.recv(64, socket.MSG_PEEK)
                        peer.sendall(stale)
                    while request := peer.recv(64):
                        peer.sendall(behind.exchange(request.rstrip(b"\r")) + b"\r")

        thread = Thread(target=relay, daemon=True)
        thread.start()
        with closing(open_sensor(f"socket://127.0.0.1:{listener.getsockname()[1]}")) as sensor:
            assert sensor.read_um() == pytest.approx(X_UM)
            peers[0].shutdown(socket.SHUT_RDWR)
            with pytest.raises(InstrumentError):
                sensor.read_um()
            assert sensor.read_um() == pytest.approx(X_UM)
        thread.join(10.0)
        assert not thread.is_alive()
        for peer in peers:
            peer.close()


@pytest.mark.usefixtures("stalls")
@pytest.mark.parametrize(
    ("banner", "at_once", "timeout_s"), [(b"\r\n", False, 1.0), (b"login: ", True, 0.2)]
)
def test_a_banner_at_a_reopened_port_does_not_cause_an_additional_failed_exchange(
    banner: bytes, timeout_s: float, *, at_once: bool, laser: Wire
) -> None:
    """``at_once``: the banner is sent before the first request, otherwise together with its
    answer."""
    connections = 3
    with socket.create_server(("127.0.0.1", 0)) as listener:
        peers: list[socket.socket] = []

        def relay() -> None:
            for number in range(connections):
                peer, _ = listener.accept()
                peers.append(peer)
                if at_once or number == 0:
                    peer.sendall(banner)
                with closing(open_link(laser.url, baud=115200, timeout_s=1.0)) as behind:
                    first = b"" if at_once or number == 0 else banner
                    while request := peer.recv(64):
                        peer.sendall(first + behind.exchange(request.rstrip(b"\r")) + b"\r")
                        first = b""

        thread = Thread(target=relay, daemon=True)
        thread.start()
        url = f"socket://127.0.0.1:{listener.getsockname()[1]}"
        with closing(open_sensor(url, timeout_s)) as sensor:
            for _ in range(connections - 1):
                assert sensor.read_um() == pytest.approx(X_UM)
                peers[-1].shutdown(socket.SHUT_RDWR)
                with pytest.raises(InstrumentError):
                    sensor.read_um()
                # a real server: the line retries at most this often
                time.sleep(serial_link.RETRY_S)
                assert sensor.read_um() == pytest.approx(X_UM)
        thread.join(10.0)
        assert not thread.is_alive()
        for peer in peers:
            peer.close()


@pytest.mark.parametrize("scheme", ["rfc2217", "RFC2217", "Rfc2217"])
def test_rfc2217_is_refused_with_what_to_use_instead(scheme: str) -> None:
    with pytest.raises(ConfigError, match="socket://HOST:PORT"):
        demo_rig({"sensor": {"url": f"{scheme}://127.0.0.1:4000"}})


def test_a_link_refuses_rfc2217_too() -> None:
    url = "rfc2217://127.0.0.1:4000"
    with pytest.raises(InstrumentError, match="socket://HOST:PORT"):
        open_link(url, baud=9600, timeout_s=0.1)


def test_the_scheme_of_a_url_may_have_capital_letters() -> None:
    assert demo_rig({"sensor": {"url": "SOCKET://Laser:4000"}}).sensor.url == "socket://Laser:4000"


READINGS = 50
MOST_MORE_S = 1.5e-3
"""Longest time that a device server may add to a reading, in s."""


@pytest.mark.usefixtures("stalls")
@pytest.mark.parametrize("server", ["ser2net", "socat"])
def test_a_reading_over_a_server_takes_little_longer(server: str, tmp_path: Path) -> None:
    """At 9600 baud the bytes arrive one by one; the server and the same terminal directly are
    measured in turn."""

    def reading_s(link: Link) -> float:
        began_s = time.monotonic()
        link.exchange(b"MS,01")
        return time.monotonic() - began_s

    def wire(name: str) -> Wire:
        return serve(str(tmp_path / name), SimulatedKeyence(lambda: X_UM), baud=9600)

    options = {"ser2net": "chardelay: false", "socat": ""}[server]
    start = ser2net if server == "ser2net" else socat
    with (
        wire("near") as near,
        wire("far") as far,
        start(far.url, tmp_path, options=options) as behind,
        closing(open_link(near.url, baud=9600, timeout_s=1.0)) as direct,
        closing(open_link(behind.url, baud=9600, timeout_s=1.0)) as remote,
    ):
        pairs = [(reading_s(direct), reading_s(remote)) for _ in range(READINGS)]
    directly_s, remotely_s = (median(times_s) for times_s in zip(*pairs, strict=True))
    print(f"{server}: a reading {1e3 * remotely_s:.2f} ms, directly {1e3 * directly_s:.2f} ms")
    assert remotely_s - directly_s <= MOST_MORE_S
