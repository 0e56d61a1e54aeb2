"""Refusals to an address that repeats them are delayed, and delay nothing else."""

import asyncio
import socket
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

import httpx
import pytest
from starlette.types import Receive, Scope, Send

from pincette_supervisor.rest import limits, server
from pincette_supervisor.rest.dependencies import HELD
from pincette_supervisor.rest.limits import HeldRefusals, Refusals
from tests.support.served import HOST, served

BURST = 3
HOLD_S = 0.3
JOB_STOP = "/api/v1/jobs/job-1/actions"
Call = Callable[[str, str], Coroutine[Any, Any, int]]


def held(test: Callable[[Call], Awaitable[None]]) -> None:
    """Run a test with an application that replies to each request with the last part of its
    path."""

    async def app(scope: Scope, _receive: Receive, send: Send) -> None:
        last = scope["path"].rpartition("/")[2]
        status = int(last) if last.isdecimal() else 404
        await send({"type": "http.response.start", "status": status, "headers": []})
        await send({"type": "http.response.body", "body": b"text"})

    async def run() -> None:
        guarded = HeldRefusals(app, Refusals(per_s=1e-3, burst=BURST))
        transport = httpx.ASGITransport(guarded, client=("192.0.2.1", 1))
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:

            async def call(method: str, path: str) -> int:
                answer = await client.request(method, path)
                assert answer.text == "text"
                return answer.status_code

            await test(call)

    asyncio.run(run())


async def ended(call: Coroutine[Any, Any, int]) -> "asyncio.Task[int]":
    """Begin a request, and run the event loop as often as the request needs without waiting."""
    task = asyncio.create_task(call)
    for _ in range(50):
        await asyncio.sleep(0.0)
    return task


@pytest.mark.parametrize("status", [400, 401, 404, 413, 422])
def test_refusals_beyond_a_burst_are_delayed(monkeypatch: pytest.MonkeyPatch, status: int) -> None:
    monkeypatch.setattr(limits, "REFUSAL_HELD_S", 3600.0)

    async def test(call: Call) -> None:
        for _ in range(BURST):
            assert await call("POST", f"/{status}") == status
        late = await ended(call("POST", f"/{status}"))
        assert not late.done()
        # What is no refusal, and all stops, are answered at once.
        for method, path, answer in (
            ("GET", "/200", 200),
            ("GET", "/503", 503),
            ("POST", "/api/v1/rigs/none/estop", 404),
            ("POST", "/api/v1//ESTOP/", 404),
            ("POST", JOB_STOP, 404),
        ):
            assert (await ended(call(method, path))).result() == answer
        late.cancel()

    held(test)


def test_a_delayed_refusal_is_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "REFUSAL_HELD_S", HOLD_S)

    async def test(call: Call) -> None:
        assert [await call("GET", "/404") for _ in range(BURST + 1)] == [404] * (BURST + 1)

    held(test)


def test_a_request_with_a_delayed_refusal_is_marked_as_the_first_to_be_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(limits, "REFUSAL_HELD_S", 3600.0)
    scopes: list[Scope] = []

    async def app(scope: Scope, _receive: Receive, send: Send) -> None:
        scopes.append(scope)
        await send({"type": "http.response.start", "status": 404, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    async def run() -> None:
        transport = httpx.ASGITransport(HeldRefusals(app, Refusals(per_s=1e-3, burst=0.0)))
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            request = asyncio.create_task(client.get("/"))
            async with asyncio.timeout(30.0):
                while not (scopes and HELD in scopes[0]):
                    await asyncio.sleep(0.0)
            request.cancel()

    asyncio.run(run())


@pytest.mark.parametrize(
    ("head", "status"),
    [
        (b"\x16\x03\x01 no HTTP\r\n\r\n", b"400"),
        (b"GET / HTTP/1.1\r\nHost: a\r\n" + b"a: b\r\n" * 300, b"431"),
    ],
)
def test_invalid_http_is_refused_at_once_or_later(
    monkeypatch: pytest.MonkeyPatch, head: bytes, status: bytes
) -> None:
    monkeypatch.setattr(server, "Refusals", lambda: Refusals(per_s=1e-3, burst=1.0))
    monkeypatch.setattr(limits, "REFUSAL_HELD_S", HOLD_S)

    async def app(_scope: Scope, _receive: Receive, _send: Send) -> None:
        raise AssertionError

    with served(app) as address:
        port = int(address.rpartition(":")[2])
        for _ in range(2):
            with socket.create_connection((HOST, port), timeout=30.0) as line:
                line.sendall(head)
                assert line.recv(64).split()[1] == status
