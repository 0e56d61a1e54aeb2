"""Programs that were started together meet at local sockets, which only their account may open."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import os
import socket
from collections.abc import Generator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, sleep

import pytest

from pincette.bus.local_sockets import (
    LONGEST,
    VARIABLE,
    by_socket,
    missing_socket,
    named_to_programs,
    socket_folder,
)
from pincette.bus.session import Joined, open_session
from pincette.bus.topology import SessionConfig, endpoint, peer_session, router_session
from pincette.engine.process import loop_services
from tests.support.rigs import free_ports

KEY = "pincette/v1/demo/job"
WITHIN_S = 5.0
NOBODY = 65534


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> Generator[Path]:
    with TemporaryDirectory(prefix="pincette-") as place:
        monkeypatch.setenv(VARIABLE, place)
        yield Path(place)


@pytest.fixture
def port() -> int:
    return free_ports(8)


@pytest.fixture
def router(folder: Path, port: int) -> Generator[Joined]:
    with socket.socket(socket.AF_UNIX) as killed:  # what a program that was killed has left
        killed.bind(str(folder / f"{port}.sock"))
    joined = open_session(router_session("127.0.0.1", port), "router")
    yield joined
    joined.close()


def sensor(port: int) -> SessionConfig:
    return peer_session("127.0.0.1", port, "sensor", loop_services(), lockstep=True)


def test_links_go_past_the_guard(router: Joined, folder: Path, port: int) -> None:
    heard: list[bytes] = []
    deadline = monotonic() + WITHIN_S
    with open_session(sensor(port), "sensor") as near:
        near.declare_subscriber(KEY, lambda one: heard.append(one.payload.to_bytes()))
        while not heard:
            router.session.put(KEY, b"it")
            assert monotonic() < deadline
            sleep(0.01)
        (link,) = router.session.info.links()
        assert str(link.src) == f"unixsock-stream/{folder}/{port}.sock"
    assert router.guard is not None
    assert router.guard.count.admitted == 0


def test_programs_started_apart_come_by_the_guard(
    router: Joined, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(VARIABLE)
    deadline = monotonic() + WITHIN_S
    with open_session(sensor(port), "sensor"):
        while not router.session.info.links():
            assert monotonic() < deadline
            sleep(0.01)
    assert router.guard is not None
    assert router.guard.count.admitted == 1


@pytest.mark.usefixtures("router")
@pytest.mark.skipif(os.geteuid() != 0, reason="only root can act as another account")
def test_no_other_account_opens_a_socket(folder: Path, port: int) -> None:
    path = str(folder / f"{port}.sock")
    with socket.socket(socket.AF_UNIX) as own, socket.socket(socket.AF_UNIX) as stranger:
        own.connect(path)
        os.seteuid(NOBODY)
        try:
            with pytest.raises(PermissionError):
                stranger.connect(path)
        finally:
            os.seteuid(0)


def test_a_folder_that_others_may_open_is_not_used(
    folder: Path, port: int, caplog: pytest.LogCaptureFixture
) -> None:
    folder.chmod(0o750)
    assert by_socket(sensor(port)) == (sensor(port), ())
    assert "mode 0700" in caplog.text


@pytest.mark.parametrize("before", [None, "/nowhere"])
def test_a_folder_of_a_run_is_named_and_goes_with_it(
    before: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    if before is None:
        monkeypatch.delenv(VARIABLE, raising=False)
    else:
        monkeypatch.setenv(VARIABLE, before)
    with named_to_programs() as named:
        assert socket_folder() == Path(named)
    assert os.environ.get(VARIABLE) == before
    assert not Path(named).exists()


@pytest.mark.parametrize("named", ["", "/nowhere", "/" + "x" * LONGEST])
def test_without_a_folder_links_go_over_tcp(
    named: str, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, named)
    assert by_socket(sensor(port)) == (sensor(port), ())


def test_other_machines_and_other_rigs_are_met_over_tcp(folder: Path) -> None:
    services = loop_services()
    joins = peer_session(
        "127.0.0.1", 7100, "controller", services, lockstep=False, router_at=("127.0.0.1", 7000)
    )
    assert by_socket(joins)[0].connect == (
        endpoint("127.0.0.1", 7000, "router"),
        f"unixsock-stream/{folder}/7102.sock",
    )
    away = peer_session("192.0.2.1", 7100, "controller", services, lockstep=False)
    assert by_socket(away)[0].connect == away.connect


def test_who_has_no_socket_is_told(folder: Path) -> None:
    config = peer_session("127.0.0.1", 7100, "estimator", loop_services(), lockstep=False)
    place = endpoint("127.0.0.1", 7100, "sensor")
    assert missing_socket(config, place) == (
        f"no socket {folder}/7101.sock: not started, or without {VARIABLE}"
    )
    (folder / "7101.sock").touch()
    assert missing_socket(config, place) == ""
