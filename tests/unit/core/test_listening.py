"""Messages for a port on which a program cannot listen: one line with the remedy for each kind
of error."""

import errno
import os
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import pytest
from fastapi import FastAPI

from pincette.bus.protocol import BusError
from pincette.bus.session import open_session
from pincette.bus.topology import SessionConfig
from pincette.config.reading import laid_over, parse_rig
from pincette.core import listening
from pincette.engine.fleet import FleetError, check_ports
from pincette.engine.threads import FailedThreads
from pincette.sim.wires.ports import WireError, open_port
from pincette_supervisor import program
from pincette_supervisor.program import PortInUseError, bind
from tests.support.rigs import demo_rig


def refused(host: str, port: int, number: int) -> str:
    return listening.why_not(host, port, OSError(number, "refused"))


def test_each_error_of_a_listening_socket_states_its_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert "stop the other program" in refused("127.0.0.1", 8000, errno.EADDRINUSE)
    assert "127.0.0.1" in refused("::1", 8000, errno.EAFNOSUPPORT)
    assert "from 1024 on" in refused("127.0.0.1", 80, errno.EACCES)
    assert "no interface" in refused("192.0.2.7", 8000, errno.EADDRNOTAVAIL)
    monkeypatch.setattr(listening, "has_ipv6", lambda: False)
    assert "no IPv6" in refused("::1", 8000, errno.EADDRNOTAVAIL)
    monkeypatch.setattr(listening, "has_ipv6", lambda: True)
    assert "no interface" in refused("2001:db8::7", 8000, errno.EADDRNOTAVAIL)


@pytest.mark.parametrize("off", [errno.EAFNOSUPPORT, errno.EADDRNOTAVAIL])
def test_every_listener_names_the_remedy_if_ipv6_is_off(
    monkeypatch: pytest.MonkeyPatch, off: int
) -> None:
    class NoIPv6(socket.socket):
        def __init__(self, family: int = socket.AF_INET, *given: int, **named: int) -> None:
            if family == socket.AF_INET6:
                raise OSError(off, "refused")
            super().__init__(family, *given, **named)

    monkeypatch.setattr(socket, "socket", NoIPv6)
    tree = demo_rig().model_dump(mode="json", exclude_unset=True)
    rig = parse_rig(laid_over(tree, {"supervisor": {"host": "::1"}}))
    for listens, error in (
        (lambda: bind("::1", 0), PortInUseError),
        (lambda: open_port("socket://[::1]:0"), WireError),
        (lambda: open_session(SessionConfig("peer", ("tcp/[::1]:17447",)), "x"), BusError),
        (lambda: check_ports(rig), FleetError),
    ):
        with pytest.raises(error, match=r"no IPv6.*127\.0\.0\.1") as raised:
            listens()
        assert "\n" not in str(raised.value)


def test_a_host_name_without_an_address_is_refused() -> None:
    with pytest.raises(OSError, match="no address is known"):
        listening.bound("no-such-host.invalid", 0)


@pytest.mark.parametrize(
    ("listens", "asked"),
    [
        ("127.0.0.1", "127.0.0.1"),
        ("0.0.0.0", "127.0.0.1"),
        ("::1", "::1"),
        ("::", "::1"),
        ("::", "127.0.0.1"),
    ],
)
def test_the_user_id_of_a_listening_program_is_found(listens: str, asked: str) -> None:
    if ":" in listens and not listening.has_ipv6():
        pytest.skip("this machine has no IPv6")
    with listening.bound(listens, 0) as listener:
        port = listener.getsockname()[1]
        assert listening.listener_uid(asked, port) is None
        listener.listen()
        assert listening.listener_uid(asked, port) == os.geteuid()
        with pytest.raises(OSError, match="stop the other program of account"):
            listening.bound(listens, port)


def test_a_rig_does_not_start_if_another_program_uses_the_port_of_rest() -> None:
    rig = demo_rig()
    with listening.bound(rig.supervisor.host, rig.supervisor.port) as other:
        other.listen()
        with pytest.raises(FleetError, match=f"supervisor: .*:{rig.supervisor.port} is in use"):
            check_ports(rig)
    check_ports(rig)


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_a_supervisor_waits_for_a_port_that_another_program_has(
    host: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    if ":" in host and not listening.has_ipv6():
        pytest.skip("this machine has no IPv6")
    monkeypatch.setattr(program, "TAKEN_LOOK_S", 0.01)
    stop = Event()
    with listening.bound(host, 0) as other:
        other.listen()
        port = other.getsockname()[1]
        with ThreadPoolExecutor(1) as threads:
            waiting = threads.submit(program.await_port, host, port, stop)
            with pytest.raises(TimeoutError):
                waiting.result(0.2)
            other.close()
            found, taken_s = waiting.result(30.0)
    assert found is not None
    assert found.getsockname()[1] == port
    assert taken_s >= 0.2
    found.listen()
    lines = [one for one in caplog.messages if f":{port} is in use" in one]
    assert len(lines) == 1
    with ThreadPoolExecutor(1) as threads:
        waiting = threads.submit(program.await_port, host, port, stop)
        stop.set()
        assert waiting.result(30.0) == (None, 0.0)
    found.close()


def test_a_supervisor_does_not_wait_for_an_address_that_the_machine_does_not_have() -> None:
    with pytest.raises(PortInUseError, match="no interface"):
        program.await_port("192.0.2.7", 8000, Event())


def test_a_supervisor_ends_if_another_program_takes_its_port_before_it_serves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """``up`` and systemd restart it then, and it waits for the port."""
    monkeypatch.setattr(threading, "excepthook", threading.excepthook)  # restored at the end
    failed, stop = FailedThreads(), Event()
    failed.end_program(stop.set)
    with (
        listening.bound("127.0.0.1", 0) as listener,
        listening.bound("127.0.0.1", listener.getsockname()[1]) as other,
    ):
        other.listen()
        with program.rest_server(listener, FastAPI(), None, stop):
            assert stop.wait(30.0)
    assert failed.names == ["rest"]
