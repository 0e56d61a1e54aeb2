"""A client that follows the events of a rig, and comes back where it was when it loses the line."""

import json
import threading
from collections.abc import Generator
from contextlib import contextmanager
from time import monotonic, sleep
from typing import cast

import httpx
from httpx_sse import SSEError, connect_sse

from tests.support.running import Json, RunningRig

SILENCE_S = 2.0
RETRY_S = 0.05
LOOK_S = 0.02


class Follower:
    """Numbered events as they came, whatever befell the line meanwhile.

    It hangs up by itself after ``patience`` events, and asks for what came after the last it heard.
    """

    def __init__(self, url: str, patience: int) -> None:
        self.events: list[Json] = []
        self.lines = 0
        """How often it had to call."""
        self._url, self._patience = url, patience
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="follower")

    def start(self) -> None:
        """Begin with the first event there is."""
        self._thread.start()

    def stop(self) -> None:
        """Hear no more."""
        self._end.set()
        self._thread.join()

    def until(self, number: int, timeout_s: float = 20.0) -> None:
        """Wait until an event has been heard."""
        deadline = monotonic() + timeout_s
        while not self.events or self.events[-1]["number"] < number:
            assert monotonic() < deadline, f"event {number} was not heard: {self.events[-1:]}"
            sleep(LOOK_S)

    def _follow(self) -> None:
        while not self._end.is_set():
            with httpx.Client(timeout=SILENCE_S, trust_env=False) as client:
                try:
                    self._hear(client)
                except (httpx.TransportError, SSEError):
                    sleep(RETRY_S)

    def _hear(self, client: httpx.Client) -> None:
        last = self.events[-1]["number"] if self.events else 0
        with connect_sse(client, "GET", self._url, headers={"Last-Event-ID": str(last)}) as line:
            line.response.raise_for_status()
            self.lines += 1
            heard = 0
            for event in line.iter_sse():
                body = cast(Json, json.loads(event.data or "{}"))
                if body.get("number") is not None:
                    self.events.append(body)
                    heard += 1
                if self._end.is_set() or heard == self._patience:
                    return


@contextmanager
def following(rig: RunningRig, patience: int) -> Generator[Follower]:
    """Follow a rig from its first event on."""
    follower = Follower(f"{rig.client.base_url}rigs/{rig.rig.rig.name}/events", patience)
    follower.start()
    try:
        yield follower
    finally:
        follower.stop()
