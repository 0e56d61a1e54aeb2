"""Published timing of services per second, so that seconds with stalls can be left out."""

import threading
from bisect import bisect_right
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from time import monotonic
from typing import cast

from pincette.core.messages import Message, Timing
from pincette.core.topics import TIMING, Topic
from pincette.engine.joiner import JOIN_WAIT_PERIODS
from tests.bench.realtime.rigs import TOLD, Rig
from tests.support.stalls import STALL_S, StallRecorder

MARGIN_S = 0.1
"""Largest delay between an event and the message that reports it, in s."""
Place = tuple[str, str]
"""A rig and one of its services."""


@dataclass(frozen=True, slots=True)
class Second:
    """Interval between two timing messages of a service."""

    begin_s: float
    end_s: float
    service: str
    missed: int
    lateness: Mapping[int, int]
    """Number of wake-ups by bucket of the lateness."""


class Seconds:
    """All intervals of some rigs since their epoch began."""

    def __init__(self, rigs: Sequence[Rig]) -> None:
        begin_s = monotonic()
        self._told: dict[Place, tuple[float, int, Counter[int]]] = {}
        """Time and content of the last timing message of a service."""
        self._all: list[Second] = []
        self._lock = threading.Lock()
        for rig in rigs:
            name = rig.file.rig.name
            self._told |= {(name, service): (begin_s, 0, Counter()) for service in TOLD}
            rig.bus.subscribe(TIMING, partial(self._hear, name))

    def _hear(self, rig: str, _topic: Topic, message: Message) -> None:
        self.note(rig, cast(Timing, message))

    def note(self, rig: str, timing: Timing) -> None:
        """Receive a timing message of a service."""
        place = rig, timing.service
        if place not in self._told:
            return
        lateness = timing.lateness
        late = Counter(dict(zip(lateness.buckets, lateness.counts, strict=True)))
        with self._lock:
            begin_s, missed, before = self._told[place]
            now = monotonic()
            self._told[place] = now, timing.missed, late
            second = Second(
                begin_s - MARGIN_S, now, timing.service, timing.missed - missed, late - before
            )
            self._all.append(second)

    def undisturbed(self, recorder: StallRecorder, period_s: float) -> list[Second]:
        """Return the intervals without a stall long enough to cost a tick."""
        return apart_from(recorder.apart(min(STALL_S, JOIN_WAIT_PERIODS * period_s)), self._all)


def apart_from(stalls: Sequence[tuple[float, float]], seconds: Sequence[Second]) -> list[Second]:
    """Return the intervals that overlap none of the stalls; stalls are (begin, end), sorted and
    without overlap."""
    ends_s = [end_s for _, end_s in stalls]
    return [
        one
        for one in seconds
        if (next_one := bisect_right(ends_s, one.begin_s)) == len(stalls)
        or stalls[next_one][0] >= one.end_s
    ]
