"""Transport of calls to a supervisor: over asyncio, or blocking.

Both retry repeatable calls.
"""

import ssl
import time
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from copy import copy
from pathlib import Path
from typing import Any, TypeVar

import httpx
from httpx_sse import EventSource, ServerSentEvent

from pincette.api import BASE
from pincette.api.events import Event
from pincette.client.call import (
    FIRST_DELAY_S,
    Attempts,
    Call,
    identity_headers,
    require_supervisor,
)
from pincette.client.errors import ClientError, problem_of
from pincette.client.live import LiveBookmark, LiveSample
from pincette.client.streaming import Bookmark, Download, require_stream, stream_details

NO_CONTENT = 204
"""HTTP status of a stream that has ended for good, for example because its job has ended."""

T = TypeVar("T")


class AsyncConnection:
    """Connection over asyncio: other tasks run while a call waits."""

    def __init__(self, http: httpx.AsyncClient) -> None:
        self._http = http

    async def request(self, details: dict[str, Any]) -> httpx.Response:
        """Send a request and read the whole reply."""
        return await self._http.request(**details)

    @asynccontextmanager
    async def stream(self, details: dict[str, Any]) -> AsyncGenerator[httpx.Response]:
        """Send a request. The body of the reply is read later, except that of a refusal, which is
        read at once.
        """
        async with self._http.stream(**details) as response:
            if response.is_error:
                await response.aread()
            yield response

    def blocks(self, response: httpx.Response) -> AsyncIterator[bytes]:
        """Yield the body block by block."""
        return response.aiter_bytes()

    def messages(self, response: httpx.Response) -> AsyncIterator[ServerSentEvent]:
        """Yield the body as server-sent events."""
        return EventSource(response).aiter_sse()

    async def sleep(self, duration_s: float) -> None:
        """Wait for a time in s."""
        import asyncio  # a blocking client does not need it

        await asyncio.sleep(duration_s)

    async def close(self) -> None:
        """Close every connection."""
        await self._http.aclose()


class BlockingConnection:
    """Blocking connection: its coroutines never suspend, so that no event loop is needed."""

    def __init__(self, http: httpx.Client) -> None:
        self._http = http

    async def request(self, details: dict[str, Any]) -> httpx.Response:
        """Send a request and read the whole reply."""
        return self._http.request(**details)

    @asynccontextmanager
    async def stream(self, details: dict[str, Any]) -> AsyncGenerator[httpx.Response]:
        """Send a request. The body of the reply is read later, except that of a refusal, which is
        read at once.
        """
        with self._http.stream(**details) as response:
            if response.is_error:
                response.read()
            yield response

    async def blocks(self, response: httpx.Response) -> AsyncIterator[bytes]:
        """Yield the body block by block."""
        for block in response.iter_bytes():
            yield block

    async def messages(self, response: httpx.Response) -> AsyncIterator[ServerSentEvent]:
        """Yield the body as server-sent events."""
        for message in EventSource(response).iter_sse():
            yield message

    async def sleep(self, duration_s: float) -> None:
        """Wait for a time in s."""
        time.sleep(duration_s)

    async def close(self) -> None:
        """Close every connection."""
        self._http.close()


Connection = AsyncConnection | BlockingConnection


class Transport:
    """Sends calls to one supervisor, and retries those that are repeatable."""

    def __init__(
        self, url: str, connection: Connection, timeout_s: float, patience_s: float
    ) -> None:
        self.url, self._connection = url.rstrip("/"), connection
        self.timeout_s, self.patience_s = timeout_s, patience_s
        self.clock: Callable[[], float] = time.monotonic
        self.sleep: Callable[[float], Awaitable[None]] = connection.sleep

    def patient(self, patience_s: float) -> "Transport":
        """Return a copy of this transport with another retry time, in s."""
        other = copy(self)
        other.patience_s = patience_s
        return other

    def within(self, timeout_s: float) -> "Transport":
        """Return a copy of this transport with another time limit for each reply, in s."""
        other = copy(self)
        other.timeout_s = timeout_s
        return other

    async def send(self, call: Call[T]) -> T:
        """Send a call and read the reply; retry the call if it is repeatable."""
        look = call.look if call.changes else None
        attempts = self._attempts(call.method, call.path, repeatable=call.repeatable, look=look)
        while True:
            try:
                response = await self._connection.request(call.details(self.timeout_s))
                require_supervisor(response)
            except httpx.TransportError as error:
                await self.sleep(attempts.delay_s(error))
            else:
                return call.answer(response)

    async def download(self, call: Call[bytes], file: Download) -> Path:
        """Stream the body of a reply into a file."""
        attempts = self._attempts(call.method, call.path, repeatable=True)
        try:
            while True:
                file.begin()
                try:
                    async with self._stream(call.details(self.timeout_s)) as response:
                        async for block in self._connection.blocks(response):
                            file.write(block)
                    return file.finish()
                except httpx.TransportError as error:
                    await self.sleep(attempts.delay_s(error))
        except BaseException:
            file.discard()
            raise

    async def events(
        self,
        path: str,
        after: int | Call[int],
        ended: Callable[[], Awaitable[bool]] | None = None,
    ) -> AsyncGenerator[Event]:
        """Yield events as they arrive, each once and without gaps, across lost connections.

        ``after`` is the number of the last known event, or the call that returns this number.
        ``ended`` returns whether a stream that the supervisor has closed is complete.
        """
        if isinstance(after, Call):
            after = await self.send(after)
        bookmark = Bookmark(path, after)
        attempts = self._attempts("GET", path, repeatable=True)
        while True:
            try:
                async with self._stream(bookmark.details(self.timeout_s)) as response:
                    attempts.succeeded()
                    if response.status_code != NO_CONTENT:
                        require_stream(response)
                        async for message in self._connection.messages(response):
                            event = bookmark.read(message)
                            if event is not None:
                                yield event
            except httpx.TransportError as error:
                await self.sleep(attempts.delay_s(error))
                continue
            if ended is not None and await ended():
                return
            await self.sleep(FIRST_DELAY_S)

    async def live(self, path: str, past_s: float) -> AsyncGenerator[LiveSample]:
        """Yield samples as they arrive, each once, across lost connections."""
        bookmark = LiveBookmark(path, past_s)
        attempts = self._attempts("GET", path, repeatable=True)
        while True:
            try:
                async with self._stream(stream_details(path, self.timeout_s)) as response:
                    require_stream(response)
                    attempts.succeeded()
                    async for message in self._connection.messages(response):
                        for sample in bookmark.read(message.data) if message.data else ():
                            yield sample
            except httpx.TransportError as error:
                await self.sleep(attempts.delay_s(error))
            else:
                await self.sleep(FIRST_DELAY_S)

    async def close(self) -> None:
        """Close every connection."""
        await self._connection.close()

    @asynccontextmanager
    async def _stream(self, details: dict[str, Any]) -> AsyncGenerator[httpx.Response]:
        async with self._connection.stream(details) as response:
            if response.is_error:
                raise problem_of(response)
            yield response

    def _attempts(
        self, method: str, path: str, *, repeatable: bool, look: str | None = None
    ) -> Attempts:
        what = f"{method} {self.url}{BASE}{path}"
        return Attempts(
            what,
            repeatable=repeatable,
            patience_s=self.patience_s,
            clock=self.clock,
            look=look,
        )


def client_settings(
    url: str,
    operator: str | None,
    key: str | None,
    authority: Path | None,
    claim: str | None = None,
) -> dict[str, Any]:
    """Return arguments of ``httpx.Client`` and ``httpx.AsyncClient``.

    Raises ClientError for an invalid URL, and for a certificate authority that cannot be read.
    """
    headers = identity_headers(operator, key, claim)
    try:
        base_url = httpx.URL(url.rstrip("/") + BASE)
    except httpx.InvalidURL as error:
        raise ClientError(f"{url} is not an address ({error})") from error
    # Loading the machine's certificate authorities would take a tenth of a command's processor
    # time. An empty context trusts none.
    verify: bool | ssl.SSLContext = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    if base_url.scheme == "https":
        verify = True
    if authority is not None and base_url.scheme == "https":
        verify = ssl.create_default_context()
        try:
            verify.load_verify_locations(authority)
        except OSError as error:
            raise ClientError(f"authority {authority}: {error.strerror or error}") from error
    return {"base_url": base_url, "headers": headers, "verify": verify, "trust_env": False}
