"""A second supervisor of a rig does not start, whatever its port and folder."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Generator
from contextlib import closing
from pathlib import Path

import pytest

from pincette.bus.protocol import BusError
from pincette.bus.session import open_session
from pincette.bus.topology import SessionConfig, client_session, router_session
from pincette.bus.zenoh_bus import ZenohBus
from pincette_supervisor import program
from pincette_supervisor.journal.store import Store, StoreError
from tests.support.adapters import until
from tests.support.rigs import free_ports

RIG, OTHER = "contract", "other"


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> Generator[SessionConfig]:
    monkeypatch.setattr(program, "GONE_S", 0.3)
    port = free_ports(1)
    with open_session(router_session("127.0.0.1", port), "router"):
        yield client_session("127.0.0.1", port)


def test_a_second_supervisor_of_a_rig_is_refused_until_the_first_has_ended(
    ends: SessionConfig,
) -> None:
    stop = threading.Event()
    with closing(ZenohBus(ends, RIG, "second")) as second:
        with closing(ZenohBus(ends, RIG, "first")) as first:
            program.serve_alone(first, RIG, stop)
            until(lambda: second.alive() == {"supervisor"}, "its token is seen")
            with pytest.raises(BusError, match="another supervisor already serves rig contract"):
                program.serve_alone(second, RIG, stop)
            with closing(ZenohBus(ends, OTHER, "another rig's")) as another:
                program.serve_alone(another, OTHER, stop)
        program.serve_alone(second, RIG, stop)
        until(lambda: second.alive() == {"supervisor"}, "its token is seen")


def test_a_router_that_does_not_reply_is_an_error_and_not_an_empty_list_of_programs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(program, "GONE_S", 0.3)
    port = free_ports(1)
    words = f"from tests.contract.test_one_supervisor import route; route({port})"
    router = subprocess.Popen([sys.executable, "-c", words], stdout=subprocess.PIPE)
    assert router.stdout is not None
    assert router.stdout.readline() == b"ready\n"
    try:
        with closing(ZenohBus(client_session("127.0.0.1", port), RIG, "tool")) as bus:
            assert bus.alive_everywhere() == set()
            router.send_signal(signal.SIGSTOP)
            os.waitpid(router.pid, os.WUNTRACED)
            for lookup in (bus.alive, bus.alive_everywhere):
                with pytest.raises(BusError, match="which programs run"):
                    lookup()
            with pytest.raises(BusError, match="which programs run"):
                program.serve_alone(bus, RIG, threading.Event())
            assert bus.other_wires() == {}
            router.send_signal(signal.SIGCONT)
            program.serve_alone(bus, RIG, threading.Event())
    finally:
        router.kill()
        router.communicate()


def route(port: int) -> None:
    """Be a router until the process is killed."""
    with open_session(router_session("127.0.0.1", port), "router"):
        print("ready", flush=True)
        threading.Event().wait()


def test_two_supervisors_do_not_share_a_journal(tmp_path: Path) -> None:
    path = tmp_path / "supervisor.sqlite"
    with closing(Store(path)) as first:
        first.work_alone()
        with (
            closing(Store(path)) as second,
            pytest.raises(StoreError, match=r"another supervisor uses it.*--data"),
        ):
            second.work_alone()
    with closing(Store(path)) as next_one:
        next_one.work_alone()
