"""Instruments whose replies come late, twice, in pieces or never, in virtual time.

``DelayedPort`` is a port for ``Line``; the bytes are those of the simulated instruments. Replies
keep their order, as in any instrument that processes one request after the other.
"""

import random
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from unittest.mock import patch

from pincette.instruments import link
from pincette.instruments.protocols import InstrumentError
from pincette.sim.instruments.protocol import TERMINATOR, Instrument

Delays = Callable[[int], list[float]]
"""Delays in s of the copies of the n-th reply: none for a lost one, two for a duplicated one."""
SPLIT_S = 0.4
"""Share of a delay after which the first half of a split reply comes."""


@dataclass(slots=True)
class Clock:
    """Virtual time."""

    now_s: float = 100.0

    def time(self) -> float:
        """Return the time, in s."""
        return self.now_s


@dataclass(slots=True)
class DelayedPort:
    """A port to one instrument; ``survives``: bytes survive a reopening of the port."""

    clock: Clock
    instrument: Instrument
    delays: Delays
    terminator: bytes = TERMINATOR
    split: bool = False
    survives: bool = True
    received_s: float = 0.0
    """Time of the newest request."""
    opened: int = 0
    _answers: int = field(default=0, init=False)
    _coming: list[tuple[float, bytes]] = field(
        default_factory=list[tuple[float, bytes]], init=False
    )
    _request: bytes = field(default=b"", init=False)

    def open(self, _within_s: float) -> "DelayedPort":
        """Open or reopen the port."""
        self.opened += 1
        if not self.survives:
            self._coming.clear()
        # Bytes that have arrived are dropped when a port is opened; bytes in transit are not.
        self._coming = [one for one in self._coming if one[0] > self.clock.now_s]
        return self

    def write(self, data: bytes) -> None:
        """Accept a request; its reply is in transit from now on."""
        self._request += data
        *lines, self._request = self._request.split(self.terminator)
        for line in lines:
            self.received_s = self.clock.now_s
            reply = self.instrument.answer(line)
            if reply is None:
                continue
            for delay_s in self.delays(self._answers):
                self._send(reply + self.terminator, delay_s)
            self._answers += 1

    def _send(self, data: bytes, delay_s: float) -> None:
        middle = len(data) // 2 if self.split else 0
        for at_s, part in ((SPLIT_S * delay_s, data[:middle]), (delay_s, data[middle:])):
            if part:
                before_s = self._coming[-1][0] if self._coming else 0.0
                self._coming.append((max(before_s, self.clock.now_s + at_s), part))

    def receive(self, wait_s: float) -> bytes:
        """Return the bytes that have arrived; time passes until some have."""
        until_s = self.clock.now_s + wait_s
        if not self._coming or self._coming[0][0] > until_s:
            self.clock.now_s = until_s
            return b""
        at_s, data = self._coming.pop(0)
        self.clock.now_s = max(self.clock.now_s, at_s)
        return data

    def close(self) -> None:
        """Keep the bytes in transit."""


@contextmanager
def virtual_ports(ports: dict[str, DelayedPort], clock: Clock) -> Generator[None]:
    """Let ``open_link`` find these ports at their urls, and use this clock."""

    def open_port(
        url: str, _baud: int, _timeout_s: float, _where: object, within_s: float
    ) -> DelayedPort:
        if url not in ports:
            raise InstrumentError(f"{url}: no such port", "cannot_open")
        return ports[url].open(within_s)

    defaults = {**(link.open_link.__kwdefaults__ or {}), "clock": clock.time}
    with (
        patch.object(link, "_open_port", open_port),
        patch.object(link.open_link, "__kwdefaults__", defaults),
    ):
        yield


def constant(delay_s: float) -> Delays:
    """Return delays that are all equal."""
    return lambda _number: [delay_s]


def drawn(most_s: float, seed: int, *, lost: float = 0.0, doubled: float = 0.0) -> Delays:
    """Return delays drawn evenly up to the largest; some replies are lost, some come twice."""
    chance = random.Random(seed)

    def delays(_number: int) -> list[float]:
        delay_s, way = chance.uniform(0.0, most_s), chance.random()
        if way < lost:
            return []
        return [delay_s, delay_s] if way < lost + doubled else [delay_s]

    return delays


def single(delay_s: float, every: int, quick_s: float) -> Delays:
    """Return a delay for each n-th reply; the others come quickly."""
    return lambda number: [delay_s if number % every == every - 1 else quick_s]
