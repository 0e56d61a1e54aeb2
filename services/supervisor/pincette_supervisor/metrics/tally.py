"""What is counted of one rig, sample by sample, as its programs tell them; never inside the loop.

It is fed by threads of the bus, so a sample costs a comparison or two; sums are made where somebody
looks.
"""

import threading
from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass

from pincette.control.safety.causes import Cause, cause_of
from pincette.latency.histogram import Distribution, Histogram
from pincette.messages import (
    Applied,
    Command,
    Estimate,
    Message,
    Position,
    Status,
    Telemetry,
    Timing,
)
from pincette.records.timings import QUANTITIES
from pincette.topics import LOOP, TOPIC_OF, Topic
from pincette_supervisor.metrics.rising import Rising, RisingDurations, summed
from pincette_supervisor.running.trips import TRIPPED

FORCE_BOUNDS_MN = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)
OBSERVED = (*LOOP, "recorder")
"""Services that are asked how they are."""


@dataclass(frozen=True, slots=True)
class Durations:
    """A histogram of durations: counts up to each bound of ``rising``, and their sum."""

    counts: tuple[int, ...]
    sum_s: float


@dataclass(frozen=True, slots=True)
class Peaks:
    """Highest forces: of the newest arming that had any, and of those that are over."""

    newest_mN: float | None
    counts: tuple[int, ...]
    """Armings up to each bound of ``FORCE_BOUNDS_MN``, the last up to none."""
    sum_mN: float


class Tally:
    """Counts of one rig since this supervisor has served it; none of them ever falls."""

    def __init__(self, applied: Applied | None = None) -> None:
        """``applied`` is what the actuator has said last, if anything is known of it."""
        self._lock = threading.Lock()
        self._trips: Counter[Cause] = Counter()
        self._trip: str = "" if applied is None else _trip_of(applied)
        self._armed = False
        self._unanswered = self._degraded = 0
        self._ages = Histogram()
        self._ages_s = 0.0
        self._numbers: dict[str, tuple[int, int]] = {}
        self._gaps: Counter[str] = Counter()
        self._peak: tuple[int, float] | None = None
        """Epoch and highest force of the newest arming that had any."""
        self._arming = -1
        """Epoch in which the actuator was last heard to be armed."""
        self._over = -1
        """Epoch of the newest arming whose peak is counted."""
        self._peaks = [0] * (len(FORCE_BOUNDS_MN) + 1)
        self._peaks_mN = 0.0
        self._missed = {service: Rising() for service in LOOP}
        self._durations = {
            (service, quantity): RisingDurations() for service in LOOP for quantity in QUANTITIES
        }
        self._refused = {service: Rising() for service in OBSERVED}
        self._lost = Rising()

    def take(self, topic: Topic, message: Message) -> None:
        """Count a sample, or what a program says of its timing."""
        with self._lock:
            match message:
                case Applied():
                    self._number(topic, message.epoch, message.seq)
                    self._judge(message)
                case Estimate():
                    self._number(topic, message.epoch, message.seq)
                    self._weigh(message)
                case Position() | Command() | Telemetry():
                    self._number(topic, message.epoch, message.seq)
                case Timing():
                    self._time(message)
                case _:
                    pass

    def _number(self, topic: Topic, epoch: int, seq: int) -> None:
        """Count the numbers that lack between two samples while the loop is armed."""
        before = self._numbers.get(topic.name)
        if self._armed and before is not None and before[0] == epoch and seq > before[1] + 1:
            self._gaps[topic.name] += seq - before[1] - 1
        if before is None or before[0] != epoch or seq > before[1]:
            self._numbers[topic.name] = epoch, seq

    def _judge(self, applied: Applied) -> None:
        trip = _trip_of(applied)
        if trip and trip != self._trip:
            self._trips[cause_of(applied.cause)] += 1
        self._trip, self._armed = trip, applied.state == "armed"
        if self._armed:
            self._arming = applied.epoch
        if applied.answered:
            self._ages.add(applied.command_age_s)
            self._ages_s += max(0.0, applied.command_age_s)
        elif self._armed:
            self._unanswered += 1
        if applied.final and self._peak is not None and self._peak[0] == applied.epoch:
            self._count_peak()

    def _weigh(self, estimate: Estimate) -> None:
        if estimate.degraded:
            self._degraded += 1
        if not estimate.valid or estimate.epoch != self._arming or estimate.epoch == self._over:
            return  # that of an idle loop goes on, and presses on nothing
        if self._peak is None or self._peak[0] != estimate.epoch:
            self._count_peak()  # of an arming whose last sample did not come
            self._peak = estimate.epoch, estimate.force_mN
        elif estimate.force_mN > self._peak[1]:
            self._peak = estimate.epoch, estimate.force_mN

    def _count_peak(self) -> None:
        if self._peak is None or self._peak[0] == self._over:
            return
        self._over, peak_mN = self._peak
        self._peaks[bisect_left(FORCE_BOUNDS_MN, peak_mN)] += 1
        self._peaks_mN += max(0.0, peak_mN)

    def _time(self, timing: Timing) -> None:
        service = timing.service
        if service not in self._missed:
            return
        self._missed[service].told(timing.missed, timing.epoch)
        for quantity in QUANTITIES:
            counted: Distribution = getattr(timing, quantity)
            self._durations[service, quantity].told(counted, timing.epoch)

    def asked(self, status: Status) -> None:
        """Take what a program has answered of itself."""
        with self._lock:
            if status.service in self._refused:
                self._refused[status.service].told(status.refused, status.instance)
            if status.service == "recorder":
                self._lost.told(status.missed, status.instance)

    def trips(self) -> dict[Cause, int]:
        """Trips of the actuator, by each cause there is."""
        with self._lock:
            return {cause: self._trips[cause] for cause in Cause}

    def gaps(self) -> dict[str, int]:
        """Numbers that lacked, by the topic's name."""
        with self._lock:
            return {topic.name: self._gaps[topic.name] for topic in NUMBERED}

    def missed(self) -> dict[str, int]:
        """Samples and points of the grid that each program of the loop has skipped."""
        with self._lock:
            return {service: count.total for service, count in self._missed.items()}

    def refused(self) -> dict[str, int]:
        """What each program has refused."""
        with self._lock:
            return {service: count.total for service, count in self._refused.items()}

    def lost(self) -> int:
        """Messages that the records lack."""
        with self._lock:
            return self._lost.total

    def unanswered(self) -> int:
        """Ticks of an armed actuator without a command that it took."""
        return self._unanswered

    def degraded(self) -> int:
        """Estimates that lacked a partner."""
        return self._degraded

    def durations(self, service: str, quantity: str) -> Durations:
        """Lateness, age or execution of a program of the loop."""
        with self._lock:
            found = self._durations[service, quantity]
            return Durations(tuple(summed(found.counts())), found.sum_s)

    def command_ages(self) -> Durations:
        """Age of the commands that the actuator took, when it took them."""
        with self._lock:
            told, sum_s = self._ages.told(), self._ages_s
        ages = RisingDurations()
        ages.told(told)
        return Durations(tuple(summed(ages.counts())), sum_s)

    def peaks(self) -> Peaks:
        """Highest forces."""
        with self._lock:
            newest = None if self._peak is None else self._peak[1]
            return Peaks(newest, tuple(summed(self._peaks)), self._peaks_mN)


NUMBERED = tuple(TOPIC_OF[kind] for kind in (Position, Estimate, Command, Telemetry, Applied))


def _trip_of(applied: Applied) -> str:
    """Cause of the trip that the actuator is in; empty where it is in none."""
    return applied.cause or "unknown" if applied.state in TRIPPED else ""
