"""Requests that no client would send, passed directly to an application: any path, headers and
bytes."""

import asyncio
import json
from collections.abc import AsyncIterator, Iterable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote

from fastapi import FastAPI

Headers = Iterable[tuple[bytes, bytes]]
JSON_HEADERS: Headers = ((b"content-type", b"application/json"),)


@dataclass(frozen=True)
class Answer:
    """Response of the application."""

    status: int
    headers: Mapping[str, str]
    body: bytes
    read: int
    """Bytes of the request's body that the application has read."""

    @property
    def problem(self) -> dict[str, Any]:
        """Return the problem document of an error."""
        assert self.headers["content-type"] == "application/problem+json", self.body[:300]
        tree = json.loads(self.body)
        assert tree.keys() >= {"type", "title", "status", "detail"}
        assert tree["status"] == self.status
        return tree


async def endless(chunk: bytes, most: int) -> AsyncIterator[bytes]:
    """Yield chunks until the application stops reading; the test fails if it reads ``most`` of
    them."""
    for _ in range(most):
        yield chunk
    raise AssertionError(f"{most} chunks of {len(chunk)} bytes were taken")


async def once(body: bytes) -> AsyncIterator[bytes]:
    """Yield a body in one piece."""
    yield body


def send(
    app: FastAPI,
    method: str,
    path: str,
    body: bytes | AsyncIterator[bytes] = b"",
    headers: Headers = JSON_HEADERS,
    wait_s: float = 120.0,
) -> Answer:
    """Send one request; the path is as on the wire, and may have a query."""
    return asyncio.run(asyncio.wait_for(_sent(app, method, path, body, headers), wait_s))


async def _sent(
    app: FastAPI, method: str, path: str, body: bytes | AsyncIterator[bytes], headers: Headers
) -> Answer:
    raw, _, query = path.partition("?")
    chunks = once(body) if isinstance(body, bytes) else body
    received = list[dict[str, Any]]()
    taken, complete = 0, False

    async def receive() -> dict[str, Any]:
        nonlocal taken, complete
        async for chunk in chunks:
            taken += len(chunk)
            return {"type": "http.request", "body": chunk, "more_body": True}
        if complete:
            await asyncio.Event().wait()  # the client stays connected and sends nothing more
        complete = True
        return {"type": "http.request", "body": b"", "more_body": False}

    async def tell(message: Any) -> None:
        received.append(message)

    scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": method,
        "scheme": "http",
        "path": unquote(raw),
        "raw_path": raw.encode("latin-1", "replace"),
        "query_string": query.encode("latin-1", "replace"),
        "root_path": "",
        "headers": [(b"host", b"127.0.0.1"), *headers],
        "client": ("127.0.0.1", 50_000),
        "server": ("127.0.0.1", 8000),
    }
    await app(scope, receive, tell)
    begun = next(message for message in received if message["type"] == "http.response.start")
    content = b"".join(m["body"] for m in received if m["type"] == "http.response.body")
    found = {name.decode(): value.decode("latin-1") for name, value in begun["headers"]}
    return Answer(begun["status"], found, content, taken)
