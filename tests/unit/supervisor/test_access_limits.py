"""How much a client may have of requests, streams, bodies and time; a stop has no limit."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import httpx
import pytest
from starlette.types import Message, Receive, Scope, Send

from pincette_supervisor.access.access import CLIENTS, Access, TokenBuckets
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.rest import limits
from pincette_supervisor.rest.api import create_app
from pincette_supervisor.rest.limits import AT_ONCE, MOST_BYTES, STREAMS, RateLimit

from .harness import Harness

ESTOP = "/api/v1/rigs/demo/estop"


def test_a_bucket_gives_a_burst_and_then_its_rate() -> None:
    buckets = TokenBuckets(per_s=10.0, burst=5.0)
    assert [buckets.wait_s("a", 0.0) for _ in range(5)] == [0.0] * 5
    assert buckets.wait_s("a", 0.0) == pytest.approx(0.1)
    assert buckets.wait_s("b", 0.0) == 0.0
    assert buckets.wait_s("a", 0.1) == 0.0
    assert buckets.wait_s("a", 0.1) == pytest.approx(0.1)
    assert [buckets.wait_s("a", 100.0) for _ in range(5)] == [0.0] * 5
    assert buckets.wait_s("a", 100.0) > 0.0


def test_a_flood_of_addresses_takes_no_more_memory() -> None:
    buckets = TokenBuckets(per_s=1.0, burst=1.0)
    for number in range(3 * CLIENTS):
        buckets.wait_s(str(number), 0.0)
        buckets.wait_s("busy", 0.0)
    assert buckets.wait_s("busy", 0.0) > 0.0
    assert buckets.wait_s("0", 0.0) == 0.0


def test_who_asks_too_often_is_told_when_to_ask_again_and_may_still_stop(harness: Harness) -> None:
    harness.app = create_app(harness.rigs, Access(buckets=TokenBuckets(per_s=1e-3, burst=2.0)))
    answers = [harness.call("GET", "/livez") for _ in range(3)]
    assert [answer.status_code for answer in answers] == [200, 200, 429]
    assert answers[-1].headers["retry-after"] == "1000"
    assert answers[-1].headers["content-type"] == "application/problem+json"
    assert answers[-1].json()["type"] == "urn:pincette:problem:too-many-requests"
    assert [harness.call("POST", ESTOP).status_code for _ in range(5)] == [200] * 5


Call = Callable[[str, str], Awaitable[httpx.Response]]


def held(test: Callable[[Call, asyncio.Event], Awaitable[None]]) -> None:
    """Run a test before an application that answers nothing but stops until it is let go."""

    async def run() -> None:
        go = asyncio.Event()

        async def app(scope: Scope, _receive: Receive, send: Send) -> None:
            if not scope["path"].endswith("/estop"):
                await go.wait()
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b""})

        transport = httpx.ASGITransport(RateLimit(app, Authenticator()))
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            await test(lambda method, path: client.request(method, path), go)

    asyncio.run(run())


@pytest.mark.parametrize(
    ("path", "most", "status"), [("/jobs", AT_ONCE, 503), ("/live", STREAMS, 429)]
)
def test_only_so_much_is_under_way_and_a_stop_comes_through(
    path: str, most: int, status: int
) -> None:
    async def test(call: Call, go: asyncio.Event) -> None:
        under_way = [asyncio.ensure_future(call("GET", path)) for _ in range(most)]
        for _ in range(50):  # turns of the loop, until each waits in the application
            await asyncio.sleep(0.0)
        refused = await call("GET", path)
        assert (refused.status_code, int(refused.headers["retry-after"]) > 0) == (status, True)
        assert (await call("POST", "/api/v1/estop")).status_code == 200
        go.set()
        assert {answer.status_code for answer in await asyncio.gather(*under_way)} == {200}
        assert (await call("GET", path)).status_code == 200

    held(test)


def test_who_does_not_take_an_answer_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "SEND_S", 0.01)

    async def app(_scope: Scope, _receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive() -> Message:
        raise AssertionError

    async def stuck(_message: Message) -> None:
        await asyncio.Event().wait()

    scope: dict[str, Any] = {"type": "http", "method": "GET", "path": "/jobs", "headers": []}
    with pytest.raises(TimeoutError):
        asyncio.run(RateLimit(app, Authenticator())(scope, receive, stuck))


@pytest.mark.parametrize("chunked", [False, True])
def test_a_body_that_is_too_large_is_refused(harness: Harness, chunked: bool) -> None:
    read: list[int] = []

    async def endless() -> Any:
        for _ in range(1000):
            read.append(1)
            yield b" " * 100_000

    content = endless() if chunked else b" " * (MOST_BYTES + 1)
    headers = {"Content-Type": "application/json"}
    answer = harness.call("POST", "/api/v1/jobs", content=content, headers=headers)
    assert answer.status_code == 413
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["type"] == "urn:pincette:problem:body-too-large"
    assert len(read) <= MOST_BYTES / 100_000 + 2


def test_a_body_as_large_as_may_be_is_read(harness: Harness) -> None:
    content = b'{"kind": "grip"}'.ljust(MOST_BYTES)
    headers = {"Content-Type": "application/json"}
    answer = harness.call("POST", "/api/v1/jobs", content=content, headers=headers)
    assert answer.status_code == 201


def test_a_body_that_does_not_come_is_given_up(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "MOST_S", 0.05)

    async def slow() -> Any:
        yield b'{"kind":'
        await asyncio.sleep(5.0)
        yield b'"grip"}'

    headers = {"Content-Type": "application/json"}
    answer = harness.call("POST", "/api/v1/jobs", content=slow(), headers=headers)
    assert (answer.status_code, answer.json()["type"]) == (
        408,
        "urn:pincette:problem:body-too-slow",
    )


def test_an_emergency_stop_needs_no_body_and_minds_none(harness: Harness) -> None:
    answer = harness.call("POST", ESTOP, content=b" " * (2 * MOST_BYTES))
    assert answer.status_code == 200


def test_a_long_wait_outlasts_the_time_of_a_body(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "MOST_S", 0.01)
    job = harness.playing_to(20)
    answer = harness.call(
        "GET", f"/api/v1/jobs/{job}", params={"wait": "terminal", "timeout_s": 0.1}
    )
    assert answer.status_code == 200
