"""The HTTP server when unknown clients hold connections: a client that stops the rig still gets
one."""

import re
import socket
from collections.abc import Generator
from contextlib import ExitStack
from pathlib import Path
from time import monotonic

import httpx
import pytest

from pincette_supervisor.access.access import Access, TokenBuckets
from pincette_supervisor.rest import server
from pincette_supervisor.rest.api import create_app
from pincette_supervisor.rest.server import MOST
from tests.support.keys import key_of_each_scope, shown
from tests.support.rigs import demo_rig
from tests.support.served import connected, served
from tests.unit.supervisor.harness import Harness

pytestmark = pytest.mark.usefixtures("stalls")

ESTOP_S = 0.5
"""Time within which a stop gets a reply while unknown clients hold every connection they can
get, in s."""
HALF_A_HEAD = b"GET /api/v1/rigs HTTP/1.1\r\nHost: localhost\r\nX-Slow: "
HALF_A_BODY = (
    b"POST /api/v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    b"Content-Length: 100000\r\n\r\n{"
)
ESTOP = b"POST /api/v1/rigs/demo/estop HTTP/1.1\r\nHost: localhost\r\n\r\n"


@pytest.fixture
def desk(tmp_path: Path) -> Generator[Harness]:
    made = Harness(demo_rig(time="lockstep"), tmp_path)
    made.app = create_app(made.rigs, Access(buckets=TokenBuckets()))
    yield made
    made.close()


def test_a_stop_succeeds_during_a_flood_of_connections(desk: Harness, figures: list[str]) -> None:
    with served(desk.app) as address, ExitStack() as held:
        for number in range(MOST + 100):
            stranger = held.enter_context(connected(address))
            if number % 2:
                stranger.sendall(HALF_A_HEAD)
        for _ in range(30):
            held.enter_context(connected(address)).sendall(HALF_A_BODY)
        begun_s = monotonic()
        with httpx.Client(base_url=address, trust_env=False, timeout=30.0) as client:
            answer = client.post("/api/v1/rigs/demo/estop")
        took_s = monotonic() - begun_s
    assert answer.status_code == 200
    assert [row.body["cause"] for row in desk.told("alarm")] == ["estop"]
    figures.append(f"estop through {MOST + 130} connections of strangers: {1e3 * took_s:.0f} ms")
    assert took_s < ESTOP_S


def last_words(one: socket.socket) -> bytes:
    """Return the bytes received before the connection ended."""
    try:
        return one.recv(100)
    except ConnectionResetError:
        return b""


def test_an_incomplete_connection_is_closed(desk: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "HEAD_S", 0.2)
    with served(desk.app) as address, ExitStack() as held:
        silent, slow = (held.enter_context(connected(address)) for _ in range(2))
        slow.sendall(HALF_A_HEAD)
        used = held.enter_context(connected(address))
        used.sendall(ESTOP)
        assert used.recv(100).startswith(b"HTTP/1.1 200 ")
        assert [last_words(one) for one in (silent, slow)] == [b"", b""]


def test_no_key_appears_in_a_log_or_a_response(
    desk: Harness, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    access = Access()
    desk.app = create_app(desk.rigs, access)
    ring = key_of_each_scope(desk.store, access.authenticator)
    key = ring.keys["observe"]
    received: list[str] = []
    with (
        caplog.at_level("DEBUG"),
        served(desk.app) as address,
        httpx.Client(base_url=f"{address}/api/v1", trust_env=False, timeout=30.0) as client,
    ):
        for method, path, headers in (
            ("GET", "/rigs", shown(key)),
            ("POST", "/jobs", shown(key)),
            ("GET", "/rigs", shown(key + "x")),
            ("GET", "/rigs", {"Authorization": key}),
            ("GET", "/rigs", {"Authorization": f"Basic {key}"}),
            ("POST", "/session", shown(key)),
            ("GET", f"/audit?key={key}", ring.headers("admin")),
        ):
            answer = client.request(method, path, headers=headers)
            received.append(answer.text + str(answer.headers))
    ours = [record.getMessage() for record in caplog.records if "httpx" not in record.name]
    output = "".join([*received, *ours, *capfd.readouterr()])
    assert not re.search(re.escape(key.removeprefix("pincette_")), output)
