"""Which missed ticks no stall accounts for, by what the programs tell once a second."""

import threading
from collections.abc import Sequence
from functools import partial
from time import monotonic
from typing import cast

from pincette.messages import Message, Timing
from pincette.topics import TIMING, Topic
from tests.bench.realtime.rigs import TOLD, Rig
from tests.support.stalls import STALL_S, StallRecorder

WAITED_PERIODS = 0.25
"""For so long a sample waits for its partner: what stands still longer may cost a tick."""
MARGIN_S = 0.1
"""Between a miss and the word of it."""


class Misses:
    """Ticks that services have missed, and within which times."""

    def __init__(self, rigs: Sequence[Rig]) -> None:
        self._heard: dict[tuple[str, str], tuple[float, int]] = {}
        """When a service of a rig told how many the last time."""
        self._found: list[tuple[float, float]] = []
        self._counts: list[int] = []
        self._lock = threading.Lock()
        begin_s = monotonic()
        for rig in rigs:
            name = rig.file.rig.name
            self._heard |= {(name, service): (begin_s, 0) for service in TOLD}
            rig.bus.subscribe(TIMING, partial(self._hear, name))

    def _hear(self, rig: str, _topic: Topic, message: Message) -> None:
        self.note(rig, cast(Timing, message))

    def note(self, rig: str, timing: Timing) -> None:
        """Take what a service tells."""
        place = rig, timing.service
        if place not in self._heard:
            return
        with self._lock:
            before_s, known = self._heard[place]
            now = monotonic()
            self._heard[place] = now, timing.missed
            if timing.missed > known:
                self._found.append((before_s - MARGIN_S, now))
                self._counts.append(timing.missed - known)

    def alone(self, recorder: StallRecorder, period_s: float) -> int:
        """Those of a second in which nothing stood still for long enough to cost one."""
        least_s = min(STALL_S, WAITED_PERIODS * period_s)
        return sum(
            count
            for (begin_s, end_s), count in zip(self._found, self._counts, strict=True)
            if not recorder.between(begin_s, end_s, least_s)
        )
