"""Calls sent one after the other: the transport of ``Supervisor``."""

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from copy import copy
from pathlib import Path
from typing import Any, TypeVar

import httpx
from httpx_sse import EventSource

from pincette.api.event_models import Event
from pincette.client.call import BASE, FIRST_DELAY_S, Attempts, Call, who
from pincette.client.errors import ClientError, problem_of
from pincette.client.following import Bookmark
from pincette.client.landing import Landing

T = TypeVar("T")


class Line:
    """A connection to one supervisor that repeats what may be repeated."""

    def __init__(
        self,
        url: str,
        timeout_s: float,
        patience_s: float,
        operator: str | None = None,
        key: str | None = None,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self.url = url.rstrip("/")
        self.timeout_s, self.patience_s = timeout_s, patience_s
        self.clock: Callable[[], float] = time.monotonic
        self.sleep: Callable[[float], None] = time.sleep
        try:
            self._http = httpx.Client(
                base_url=f"{self.url}{BASE}",
                trust_env=False,
                transport=transport,
                headers=who(operator, key),
            )
        except httpx.InvalidURL as error:
            raise ClientError(f"{url} is no address ({error})") from error

    def patient(self, patience_s: float) -> "Line":
        """The same line, with more patience or less."""
        other = copy(self)
        other.patience_s = patience_s
        return other

    def send(self, call: Call[T]) -> T:
        """Send a call, again where that is safe, and read the answer."""
        attempts = self._attempts(call.method, call.path, repeatable=call.repeatable)
        while True:
            try:
                response = self._http.request(**call.details(self.timeout_s))
            except httpx.TransportError as error:
                self.sleep(attempts.delay_s(error))
            else:
                return call.answer(response)

    def land(self, call: Call[Any], landing: Landing) -> Path:
        """Stream the body of an answer into a file."""
        attempts = self._attempts(call.method, call.path, repeatable=True)
        try:
            while True:
                landing.begin()
                try:
                    with self._stream(call.details(self.timeout_s)) as response:
                        for block in response.iter_bytes():
                            landing.take(block)
                    return landing.done()
                except httpx.TransportError as error:
                    self.sleep(attempts.delay_s(error))
        except BaseException:
            landing.abandon()
            raise

    def events(
        self, path: str, after: int | Call[int], over: Callable[[], bool] = lambda: False
    ) -> Iterator[Event]:
        """Events as they come, without gap or double, over as many connections as it takes.

        ``after`` is the number of the last event that is known, or the call that tells it.
        ``over`` is asked whether a stream that the supervisor closed has come to its end.
        """
        if isinstance(after, Call):
            after = self.send(after)
        bookmark = Bookmark(path, after)
        attempts = self._attempts("GET", path, repeatable=True)
        while True:
            try:
                with self._stream(bookmark.details(self.timeout_s)) as response:
                    bookmark.require_stream(response)
                    attempts.succeeded()
                    for said in EventSource(response).iter_sse():
                        event = bookmark.read(said)
                        if event is not None:
                            yield event
            except httpx.TransportError as error:
                self.sleep(attempts.delay_s(error))
                continue
            if over():
                return
            self.sleep(FIRST_DELAY_S)

    def close(self) -> None:
        """Give the connections back."""
        self._http.close()

    @contextmanager
    def _stream(self, details: dict[str, Any]) -> Generator[httpx.Response]:
        with self._http.stream(**details) as response:
            if response.is_error:
                response.read()
                raise problem_of(response)
            yield response

    def _attempts(self, method: str, path: str, *, repeatable: bool) -> Attempts:
        what = f"{method} {self.url}{BASE}{path}"
        return Attempts(what, repeatable=repeatable, patience_s=self.patience_s, clock=self.clock)
