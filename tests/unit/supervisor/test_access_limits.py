"""Limits of a client for requests, streams, bodies and time; a stop has no limit."""

import asyncio
import gzip
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from typing import Any

import httpx
import pytest
from pydantic import ValidationError
from starlette.types import Message, Receive, Scope, Send

from pincette.config import RigFile
from pincette.config.programs import Supervisor
from pincette_supervisor.access.access import CLIENTS, Access, TokenBuckets
from pincette_supervisor.access.authentication import Authenticator, Caller
from pincette_supervisor.config import configure
from pincette_supervisor.problems import ERRORS_MAX
from pincette_supervisor.rest import limits
from pincette_supervisor.rest.limits import (
    AT_ONCE,
    LARGE_BYTES,
    LONG_BURST,
    OF_ONE,
    SMALL_BYTES,
    Kind,
    RateLimit,
)
from tests.support.api_document import openapi
from tests.support.apps import create_app

from .harness import Harness

ESTOP = "/api/v1/rigs/demo/estop"
NOT_HELD = {"short": 0.0, "long": 0.0}


def test_a_token_bucket_permits_a_burst_and_then_its_rate() -> None:
    buckets = TokenBuckets(per_s=10.0, burst=5.0)
    assert [buckets.wait_s("a", 0.0) for _ in range(5)] == [0.0] * 5
    assert buckets.wait_s("a", 0.0) == pytest.approx(0.1)
    assert buckets.wait_s("b", 0.0) == 0.0
    assert buckets.wait_s("a", 0.1) == 0.0
    assert buckets.wait_s("a", 0.1) == pytest.approx(0.1)
    assert [buckets.wait_s("a", 100.0) for _ in range(5)] == [0.0] * 5
    assert buckets.wait_s("a", 100.0) > 0.0


def test_waiting_callers_of_a_bucket_are_served_in_order() -> None:
    buckets = TokenBuckets(per_s=10.0, burst=1.0)
    waits = [buckets.wait_s("a", 0.0, patience_s=0.25) for _ in range(4)]
    assert waits == pytest.approx([0.0, 0.1, 0.2, 0.3])
    # The last one did not wait, so it used no token.
    assert buckets.wait_s("a", 0.1, patience_s=0.25) == pytest.approx(0.2)


def test_clients_of_one_address_beyond_its_rate_are_delayed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(limits, "HELD_S", NOT_HELD)
    app = RateLimit(answered, Authenticator(), buckets=TokenBuckets(per_s=200.0, burst=1.0))

    async def run() -> set[int]:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            found = await asyncio.gather(*(client.get("/jobs") for _ in range(50)))
            return {answer.status_code for answer in found}

    assert asyncio.run(run()) == {200}


def test_a_flood_of_addresses_needs_no_more_memory() -> None:
    buckets = TokenBuckets(per_s=1.0, burst=1.0)
    for number in range(3 * CLIENTS):
        buckets.wait_s(str(number), 0.0)
        buckets.wait_s("busy", 0.0)
    assert buckets.wait_s("busy", 0.0) > 0.0
    assert buckets.wait_s("0", 0.0) == 0.0


def test_a_client_beyond_its_rate_gets_a_retry_time_and_may_still_stop(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    harness.app = create_app(harness.rigs, Access(buckets=TokenBuckets(per_s=1e-3, burst=2.0)))
    monkeypatch.setattr(limits, "HELD_S", NOT_HELD)
    answers = [harness.call("GET", "/livez") for _ in range(3)]
    assert [answer.status_code for answer in answers] == [200, 200, 429]
    assert 900 < int(answers[-1].headers["retry-after"]) <= 1000
    assert answers[-1].headers["content-type"] == "application/problem+json"
    assert answers[-1].json()["type"] == "urn:pincette:problem:too-many-requests"
    assert [harness.call("POST", ESTOP).status_code for _ in range(5)] == [200] * 5


async def answered(_scope: Scope, _receive: Receive, send: Send) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b""})


Call = Callable[..., Coroutine[Any, Any, httpx.Response]]
ACTIONS = "/api/v1/jobs/job-1/actions"


class OfKeys(Authenticator):
    """Accepts any key as the name of its caller."""

    def identify(self, address: str, shown: str | None, cookie: str | None) -> Caller:
        del cookie
        return Caller(address, shown, "operate" if shown else None, "key" if shown else "none")


def held(
    monkeypatch: pytest.MonkeyPatch, test: Callable[[Call, asyncio.Event], Awaitable[None]]
) -> None:
    """Run a test with an application that replies only to stops until it is released."""
    monkeypatch.setattr(limits, "HELD_S", NOT_HELD)

    async def run() -> None:
        go = asyncio.Event()

        async def app(scope: Scope, _receive: Receive, send: Send) -> None:
            if not scope["path"].endswith(("/estop", "/actions")):
                await go.wait()
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b""})

        transport = httpx.ASGITransport(RateLimit(app, OfKeys()))
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:

            def call(
                method: str, path: str, key: str = "ann"
            ) -> Coroutine[Any, Any, httpx.Response]:
                headers = {"Authorization": f"Bearer {key}"} if key else {}
                return client.request(method, path, headers=headers)

            await test(call, go)

    asyncio.run(run())


async def under_way(
    calls: list[Coroutine[Any, Any, httpx.Response]],
) -> list[asyncio.Task[httpx.Response]]:
    """Begin requests, and let them reach the application."""
    begun = [asyncio.create_task(one) for one in calls]
    for _ in range(50):
        await asyncio.sleep(0.0)
    return begun


def kind_of(path: str) -> Kind:
    return "short" if path == "/jobs" else "long"


LONG = ["/rigs/demo/live", "/events", "/jobs/a?wait=change", "/jobs/a?timeout_s=1&wait=terminal"]


@pytest.mark.parametrize(("path", "other"), [("/jobs", LONG[0]), *((one, "/jobs") for one in LONG)])
def test_the_number_of_concurrent_requests_of_one_client_is_limited_for_each_kind(
    monkeypatch: pytest.MonkeyPatch, path: str, other: str
) -> None:
    async def test(call: Call, go: asyncio.Event) -> None:
        begun = await under_way([call("GET", path) for _ in range(OF_ONE[kind_of(path)])])
        refused = await call("GET", path)
        assert refused.status_code == 429
        assert int(refused.headers["retry-after"]) > 0
        # Another client, the other kind of request, and all stops are not affected.
        begun += await under_way([call("GET", path, "ben"), call("GET", other)])
        for place in ("/api/v1/estop", ACTIONS):
            assert (await call("POST", place)).status_code == 200
        go.set()
        assert {answer.status_code for answer in await asyncio.gather(*begun)} == {200}
        assert (await call("GET", path)).status_code == 200

    held(monkeypatch, test)


@pytest.mark.parametrize("path", ["/jobs", LONG[0]])
def test_the_number_of_concurrent_requests_of_all_clients_is_limited(
    monkeypatch: pytest.MonkeyPatch, path: str
) -> None:
    async def test(call: Call, go: asyncio.Event) -> None:
        most, of_one = AT_ONCE[kind_of(path)], OF_ONE[kind_of(path)]
        keys = [f"key{number // of_one}" for number in range(most)]
        begun = await under_way([call("GET", path, key) for key in keys])
        assert (await call("GET", path, "another")).status_code == 503
        for place in ("/api/v1/estop", ACTIONS):
            assert (await call("POST", place)).status_code == 200
        go.set()
        assert {answer.status_code for answer in await asyncio.gather(*begun)} == {200}

    held(monkeypatch, test)


def test_a_flood_of_long_polls_does_not_reduce_the_permitted_rate_of_other_requests(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def test(call: Call, go: asyncio.Event) -> None:
        go.set()
        polls = [call("GET", LONG[2]) for _ in range(3 * int(LONG_BURST))]
        assert {poll.status_code for poll in await asyncio.gather(*polls)} == {200, 429}
        assert (await call("GET", "/jobs")).status_code == 200

    held(monkeypatch, test)


def test_actions_without_a_key_are_limited_too(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(call: Call, go: asyncio.Event) -> None:
        begun = await under_way([call("GET", "/jobs", "") for _ in range(OF_ONE["short"])])
        assert (await call("POST", ACTIONS, "")).status_code == 429
        go.set()
        await asyncio.gather(*begun)

    held(monkeypatch, test)


def test_without_keys_the_limits_of_one_address_are_a_configured_multiple_of_those_of_a_client(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """50 honest clients behind one proxy, each with its streams."""
    monkeypatch.setattr(limits, "HELD_S", NOT_HELD)

    async def run() -> None:
        go = asyncio.Event()

        async def app(scope: Scope, receive: Receive, send: Send) -> None:
            await go.wait()
            await answered(scope, receive, send)

        buckets = TokenBuckets(per_s=1e-3, burst=3.0)
        limited = RateLimit(app, OfKeys(), buckets=buckets, clients_per_address=50)
        transport = httpx.ASGITransport(limited)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            streams = await under_way([client.get("/events") for _ in range(AT_ONCE["long"])])
            requests = await under_way([client.get("/jobs") for _ in range(150)])
            assert (await client.get("/events")).status_code == 503  # the limit of all clients
            assert (await client.get("/jobs")).status_code == 429
            # A key has the limits of one client.
            shown = {"Authorization": "Bearer ann"}
            keyed = await under_way([client.get("/jobs", headers=shown) for _ in range(3)])
            assert (await client.get("/jobs", headers=shown)).status_code == 429
            go.set()
            found = await asyncio.gather(*streams, *requests, *keyed)
        assert {answer.status_code for answer in found} == {200}

    asyncio.run(run())


def test_the_configuration_sets_the_number_of_clients_of_an_address(
    rig_file: RigFile, tmp_path: Path
) -> None:
    assert configure(rig_file, tmp_path).clients_per_address == 1
    supervisor = rig_file.supervisor.model_copy(update={"clients_per_address": 50})
    rig = rig_file.model_copy(update={"supervisor": supervisor})
    assert configure(rig, tmp_path).clients_per_address == 50
    for odd in (0, 257, 1.5):
        with pytest.raises(ValidationError):
            Supervisor(clients_per_address=odd)  # pyright: ignore[reportArgumentType]


def test_addresses_of_one_ipv6_network_are_one_client() -> None:
    assert Caller("2001:db8::1").client == Caller("2001:db8::ffff:2").client
    assert Caller("2001:db8::1").client != Caller("2001:db8:0:1::1").client
    assert Caller("192.0.2.1").client == "192.0.2.1"
    assert Caller("2001:db8::1", "ann").client == "ann"


def test_a_stop_of_a_job_is_not_limited_and_other_actions_are(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "HELD_S", NOT_HELD)
    job = harness.playing_to(20)
    harness.app = create_app(harness.rigs, Access(buckets=TokenBuckets(per_s=1e-3, burst=3.0)))
    while harness.call("GET", "/livez").status_code == 200:
        pass
    act = f"/api/v1/jobs/{job}/actions"
    assert harness.call("POST", act, json={"type": "pause"}).status_code == 429
    assert harness.call("POST", act, json={"type": "stop"}).status_code in (200, 202)
    assert harness.call("POST", act, json={"type": "abort"}).status_code in (200, 202, 409)
    stop = {"idempotency_key": "k"}
    assert harness.call("POST", "/api/v1/jobs/stop", json=stop).status_code == 200


def test_a_client_that_does_not_read_its_response_is_disconnected(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
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
@pytest.mark.parametrize(
    ("method", "path", "most_bytes"),
    [
        ("POST", "/jobs", LARGE_BYTES),
        ("POST", "/trajectories", LARGE_BYTES),
        ("POST", "/recipes", LARGE_BYTES),
        ("PATCH", "/jobs/job-1", LARGE_BYTES),
        ("POST", "/jobs/stop", SMALL_BYTES),
        ("POST", "/jobs/job-1/actions", SMALL_BYTES),
        ("POST", "/rigs/demo/reset", SMALL_BYTES),
        ("PUT", "/rigs/demo/claim", SMALL_BYTES),
        ("POST", "/session", 4096),
    ],
)
def test_a_body_beyond_the_limit_of_its_route_is_refused(
    harness: Harness, method: str, path: str, most_bytes: int, chunked: bool
) -> None:
    read: list[int] = []

    async def endless() -> Any:
        for _ in range(1000):
            read.append(1)
            yield b" " * 100_000

    content = endless() if chunked else b" " * (most_bytes + 1)
    headers = {"Content-Type": "application/json"}
    answer = harness.call(method, f"/api/v1{path}", content=content, headers=headers)
    assert answer.status_code == 413
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["type"] == "urn:pincette:problem:body-too-large"
    assert answer.json()["limit_bytes"] == most_bytes
    assert len(read) <= most_bytes / 100_000 + 2
    operation = openapi()["paths"][
        f"/api/v1{path}".replace("job-1", "{job}").replace("demo", "{rig}")
    ][method.lower()]
    assert operation["x-max-bytes"] == most_bytes


def test_a_body_of_the_maximum_size_is_read(harness: Harness) -> None:
    content = b'{"kind": "grip"}'.ljust(LARGE_BYTES)
    headers = {"Content-Type": "application/json"}
    answer = harness.call("POST", "/api/v1/jobs", content=content, headers=headers)
    assert answer.status_code == 201


@pytest.mark.parametrize(
    "body",
    [
        "{" + ", ".join(f'"f{n}": 1' for n in range(12_001)) + "}",
        '{"kind": "grip", "labels": [' + "1," * 25_000 + "1]}",
        '{"kind": "grip", "labels": ' + "[" * 25_000 + "]" * 25_000 + "}",
    ],
    ids=["members", "items", "depth"],
)
def test_a_body_with_too_many_elements_is_refused_before_it_is_parsed(
    harness: Harness, body: str
) -> None:
    headers = {"Content-Type": "application/json"}
    answer = harness.call("POST", "/api/v1/jobs", content=body.encode(), headers=headers)
    assert (answer.status_code, answer.json()["type"]) == (
        413,
        "urn:pincette:problem:body-too-large",
    )


def test_the_number_of_listed_errors_is_limited(harness: Harness) -> None:
    long = "x" * 5_000
    body = {"kind": "grip", **{f"{long}{n}": 1 for n in range(40)}}
    answer = harness.post("/jobs", body)
    assert answer.status_code == 422
    assert len(answer.json()["errors"]) == ERRORS_MAX
    assert "and 20 more" in answer.json()["detail"]
    assert len(answer.content) < 20_000


@pytest.mark.usefixtures("ring")
def test_a_body_is_not_read_without_a_key(harness: Harness) -> None:
    taken: list[int] = []

    async def chunks() -> Any:
        for _ in range(10):
            taken.append(1)
            yield b" " * 1000

    headers = {"Content-Type": "application/json"}
    for path in ("/jobs", "/jobs/stop", "/recipes", "/trajectories", "/rigs/demo/reset"):
        answer = harness.call("POST", f"/api/v1{path}", content=chunks(), headers=headers)
        assert answer.status_code == 401
    assert taken == []


def test_an_encoded_body_is_refused(harness: Harness) -> None:
    headers = {"Content-Type": "application/json", "Content-Encoding": "gzip"}
    content = gzip.compress(b'{"kind": "grip"}')
    answer = harness.call("POST", "/api/v1/jobs", content=content, headers=headers)
    assert answer.status_code == 415


def test_many_query_parameters_are_refused(harness: Harness) -> None:
    answer = harness.call("GET", "/api/v1/jobs?" + "&".join(f"a{n}" for n in range(3000)))
    assert answer.status_code == 422
    assert len(answer.content) < 2_000


def test_a_missing_body_ends_the_request(harness: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "BODY_S", 0.05)

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


def test_an_emergency_stop_needs_no_request_body_and_ignores_any(harness: Harness) -> None:
    answer = harness.call("POST", ESTOP, content=b" " * (2 * LARGE_BYTES))
    assert answer.status_code == 200


def test_a_long_poll_may_last_longer_than_the_time_limit_of_a_body(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "BODY_S", 0.01)
    job = harness.playing_to(20)
    answer = harness.call(
        "GET", f"/api/v1/jobs/{job}", params={"wait": "terminal", "timeout_s": 0.1}
    )
    assert answer.status_code == 200
