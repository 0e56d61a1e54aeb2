"""A subscriber that receives what a rig publishes and notes the time of arrival."""

import os
import sys
from bisect import bisect_left
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic, sleep
from typing import Any, TypeVar

from pincette.bus.endpoints import tool_endpoint
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.core.messages import Applied, Message
from pincette.core.topics import (
    APPLIED,
    COMMAND,
    ESTIMATE,
    GROUND_TRUTH,
    POSITION,
    TELEMETRY,
    Topic,
)
from pincette.engine.realtime.os_scheduling import FIFO

M = TypeVar("M", bound=Message)
HEARD = (POSITION, ESTIMATE, COMMAND, APPLIED, TELEMETRY, GROUND_TRUTH)
LOOK_S = 0.002


class Witness:
    """Messages by kind, each with the monotonic time of its arrival here.

    Its times include the path through the router, so they are never too short.
    """

    def __init__(self, bus: ZenohBus) -> None:
        self.bus = bus
        self._times: dict[type, list[float]] = {topic.message: [] for topic in HEARD}
        self._heard: dict[type, list[Any]] = {topic.message: [] for topic in HEARD}
        for topic in HEARD:
            bus.subscribe(topic, self._take)

    def _take(self, topic: Topic, message: Message) -> None:
        self._heard[topic.message].append(message)
        self._times[topic.message].append(monotonic())

    def since(self, kind: type[M], since_s: float) -> list[tuple[float, M]]:
        """Return messages of a kind that arrived at ``since_s`` or later, with their times."""
        times, heard = self._times[kind], self._heard[kind]
        first, last = bisect_left(times, since_s), len(times)
        return [(times[place], heard[place]) for place in range(first, last)]

    def forget(self, before_s: float) -> None:
        """Delete messages that arrived before ``before_s``, so that the memory of a long test
        stays small."""
        for kind, times in self._times.items():
            count = bisect_left(times, before_s)
            del self._heard[kind][:count], times[:count]

    def newest(self, kind: type[M]) -> M:
        """Return the newest message of a kind; raises IndexError if there is none."""
        return self._heard[kind][len(self._times[kind]) - 1]

    def until(
        self, kind: type[M], holds: Callable[[M], bool], since_s: float, timeout_s: float = 10.0
    ) -> tuple[float, M]:
        """Wait for the first message of a kind that satisfies a condition; returns it with its
        time."""
        deadline = monotonic() + timeout_s
        first = bisect_left(self._times[kind], since_s)
        while monotonic() < deadline:
            for place in range(first, len(self._times[kind])):
                if holds(self._heard[kind][place]):
                    return self._times[kind][place], self._heard[kind][place]
                first = place + 1
            sleep(LOOK_S)
        newest = {topic.name: self._heard[topic.message][-1:] for topic in HEARD}
        raise TimeoutError(f"no such {kind.__name__} within {timeout_s:g} s; newest: {newest}")

    def account(self, at_s: float, span_s: float) -> str:
        """Return the messages shortly before and after a time, in ms relative to it; for a
        failure's text."""
        lines: list[tuple[float, str]] = []
        for topic in HEARD:
            for came_s, message in self.since(topic.message, at_s - span_s):
                if came_s < at_s + 0.2 * span_s:
                    seq, state = getattr(message, "seq", None), getattr(message, "state", "")
                    lines.append((1e3 * (came_s - at_s), f"{topic.name} {seq} {state}"))
        return "\n".join(f"{came_ms:8.1f} {text}" for came_ms, text in sorted(lines))

    def until_state(self, states: tuple[str, ...], since_s: float) -> tuple[float, Applied]:
        """Wait until the actuator reports one of some states; returns the message with its time."""
        return self.until(Applied, lambda applied: applied.state in states, since_s)


@contextmanager
def witness(rig: RigFile) -> Generator[Witness]:
    """Subscribe to a running rig through its router."""
    bus = ZenohBus(tool_endpoint(rig), rig.rig.name, "witness")
    try:
        outsider = Witness(bus)
        _hear_first()
        yield outsider
    finally:
        bus.close()


def _hear_first() -> None:
    """Give the receiving threads the priority of the loop: their delay would count as the loop's.

    The test itself keeps its priority, since programs that it starts inherit it.
    """
    if sys.platform != "linux":
        return
    for thread in Path("/proc/self/task").iterdir():
        if int(thread.name) != os.getpid():
            with suppress(OSError):
                os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(FIFO))
