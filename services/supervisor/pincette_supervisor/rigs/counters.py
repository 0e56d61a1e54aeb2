"""Counters of one rig, updated with every sample in threads of the bus."""

import threading
from bisect import bisect_left
from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass
from itertools import accumulate, product

from pincette.core.faults import CAUSES, TRIPPED, Cause, Mode
from pincette.core.messages import (
    Applied,
    Command,
    Estimate,
    Message,
    Position,
    Status,
    Telemetry,
    Timing,
)
from pincette.core.messages.requests import InstrumentCounts
from pincette.core.topics import LOOP, TOPIC_OF, Topic
from pincette.latency.histogram import Distribution, Histogram, first_ns
from pincette.records.timings import QUANTITIES
from pincette_supervisor.alarms import TripReason, reason_of

# Counters and histograms that never fall, of sources that restart at zero; pure.

# fmt: off
BOUNDS_S = (
    1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0,
)
# fmt: on
"""Bounds of durations: 1, 2 and 5 of each decade."""
BOUNDS_NS = tuple(round(1e9 * bound_s) for bound_s in BOUNDS_S)
NS_PER_S = 1e9


class MonotonicCounter:
    """A count that continues when its source restarts at zero."""

    __slots__ = ("_before", "_newest", "_start")

    def __init__(self) -> None:
        self._start: Hashable = None
        self._before = self._newest = 0

    def update(self, count: int, start: Hashable = None) -> None:
        """Add the source's count; another ``start``, or a smaller count, means a restart."""
        if start != self._start or count < self._newest:
            self._before += self._newest
        self._start, self._newest = start, count

    @property
    def total(self) -> int:
        """Return the total over all restarts."""
        return self._before + self._newest


class MonotonicHistogram:
    """A histogram that continues when its source restarts empty."""

    __slots__ = ("_before", "_before_s", "_newest", "_start")

    def __init__(self) -> None:
        self._start: Hashable = None
        self._before = [0] * (len(BOUNDS_NS) + 1)
        self._before_s = 0.0
        self._newest = Distribution()

    def update(self, counted: Distribution, start: Hashable = None) -> None:
        """Add the source's histogram; another ``start``, or a smaller count, means a restart."""
        if start != self._start or not _grown(self._newest, counted):
            self._before = self.counts()
            self._before_s = self.sum_s
        self._start, self._newest = start, counted

    def counts(self) -> list[int]:
        """Return the number of durations between consecutive bounds, and beyond the last bound."""
        counts = [*self._before]
        for bucket, count in zip(self._newest.buckets, self._newest.counts, strict=True):
            counts[bound_index(bucket)] += count
        return counts

    @property
    def sum_s(self) -> float:
        """Return the sum of all durations, in s, from bucket centres; the error is at most 1/64."""
        counted = zip(self._newest.buckets, self._newest.counts, strict=True)
        return self._before_s + sum(_middle_s(bucket) * count for bucket, count in counted)


def bound_index(bucket: int) -> int:
    """Return the index of the smallest bound above the durations of a bucket; the error is at
    most 1/32."""
    return bisect_left(BOUNDS_NS, first_ns(bucket + 1) - 1)


def _grown(before: Distribution, after: Distribution) -> bool:
    """Return whether no bucket has a smaller count than before."""
    having = dict(zip(after.buckets, after.counts, strict=True))
    return all(
        having.get(bucket, 0) >= count
        for bucket, count in zip(before.buckets, before.counts, strict=True)
    )


def _middle_s(bucket: int) -> float:
    return (first_ns(bucket) + first_ns(bucket + 1) - 1) / 2.0 / NS_PER_S


# Counters of one rig, updated with every sample in threads of the bus.

FORCE_BOUNDS_MN = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)
OBSERVED = (*LOOP, "recorder")
"""Services whose status is requested."""
WITH_INSTRUMENT = ("sensor", "actuator")
INSTRUMENT_KINDS = InstrumentCounts.__struct_fields__


@dataclass(frozen=True, slots=True)
class Durations:
    """A cumulative histogram of durations over ``BOUNDS_S``, and their sum."""

    counts: tuple[int, ...]
    sum_s: float


@dataclass(frozen=True, slots=True)
class Peaks:
    """Peak force of the newest arming with a force, and distribution of those of finished
    armings.
    """

    newest_mN: float | None
    counts: tuple[int, ...]
    """Cumulative counts of armings over ``FORCE_BOUNDS_MN``; the last count has no bound."""
    sum_mN: float


class RigCounters:
    """Counters of one rig since this supervisor began to serve it; no counter ever decreases."""

    def __init__(self, applied: Applied | None = None) -> None:
        """Create the counters.

        A trip in ``applied``, the actuator's last message, is not counted.
        """
        self._lock = threading.Lock()
        self._trips: Counter[Cause] = Counter()
        self._trip: TripReason | None = None if applied is None else _trip_of(applied)
        self._armed = False
        self.unanswered = self.degraded = 0
        """Number of ticks of an armed actuator without a command, and of estimates from incomplete
        inputs."""
        self._ages = Histogram()
        self._ages_s = 0.0
        self._numbers: dict[str, tuple[int, int]] = {}
        self._gaps: Counter[str] = Counter()
        self._peak: tuple[int, float] | None = None
        """Epoch and highest force of the newest arming that had any."""
        self._arming = -1
        """Epoch of the actuator's newest message in which it was armed."""
        self._over = -1
        """Epoch of the newest arming whose peak is counted."""
        self._peaks = [0] * (len(FORCE_BOUNDS_MN) + 1)
        self._peaks_mN = 0.0
        self._missed = {service: MonotonicCounter() for service in LOOP}
        self._durations = {
            (service, quantity): MonotonicHistogram() for service in LOOP for quantity in QUANTITIES
        }
        self._refused = {service: MonotonicCounter() for service in (*OBSERVED, "rig")}
        self._instrument = {
            pair: MonotonicCounter() for pair in product(WITH_INSTRUMENT, INSTRUMENT_KINDS)
        }
        self._gone: Counter[str] = Counter()
        self._zero_returns: Counter[bool] = Counter()
        self.lost = MonotonicCounter()
        """Number of messages missing from records."""

    def take(self, topic: Topic, message: Message) -> None:
        """Count a sample, or a program's timing statistics."""
        with self._lock:
            if isinstance(message, Position | Estimate | Command | Telemetry | Applied):
                self._check_seq(topic, message.epoch, message.seq)
            if isinstance(message, Applied):
                self._take_applied(message)
            elif isinstance(message, Estimate):
                self._take_estimate(message)
            elif isinstance(message, Timing):
                self._take_timing(message)

    def count_zero_return(self, *, verified: bool) -> None:
        """Count a job whose arm returned to the position of its zero."""
        with self._lock:
            self._zero_returns[verified] += 1

    def zero_returns(self) -> dict[bool, int]:
        """Return the numbers of jobs whose zero was verified, and not verified, by the return."""
        with self._lock:
            return {verified: self._zero_returns[verified] for verified in (True, False)}

    def _check_seq(self, topic: Topic, epoch: int, seq: int) -> None:
        """Count missing sequence numbers while the loop is armed."""
        before = self._numbers.get(topic.name)
        if self._armed and before is not None and before[0] == epoch and seq > before[1] + 1:
            self._gaps[topic.name] += seq - before[1] - 1
        if before is None or before[0] != epoch or seq > before[1]:
            self._numbers[topic.name] = epoch, seq

    def _take_applied(self, applied: Applied) -> None:
        trip = _trip_of(applied)
        # Further faults of a trip may be found after it has begun; another cause means another
        # trip.
        if trip and (self._trip is None or trip.cause != self._trip.cause):
            self._trips[trip.cause or Cause.ASKED] += 1
        self._trip, self._armed = trip, applied.state == Mode.ARMED
        if self._armed:
            self._arming = applied.epoch
        if applied.answered:
            self._ages.add(applied.command_age_s)
            self._ages_s += max(0.0, applied.command_age_s)
        elif self._armed:
            self.unanswered += 1
        if applied.final and self._peak is not None and self._peak[0] == applied.epoch:
            self._count_peak()

    def _take_estimate(self, estimate: Estimate) -> None:
        if estimate.degraded:
            self.degraded += 1
        if not estimate.valid or estimate.epoch != self._arming or estimate.epoch == self._over:
            return  # not armed: an idle loop continues to estimate
        if estimate.arms[0].zero_age_s is None:
            return  # without a zero the estimate has no reference, and is not a force
        if self._peak is None or self._peak[0] != estimate.epoch:
            self._count_peak()  # count the previous arming, whose last sample was lost
            self._peak = estimate.epoch, estimate.arms[0].force_mN
        elif estimate.arms[0].force_mN > self._peak[1]:
            self._peak = estimate.epoch, estimate.arms[0].force_mN

    def _count_peak(self) -> None:
        if self._peak is None or self._peak[0] == self._over:
            return
        self._over, peak_mN = self._peak
        self._peaks[bisect_left(FORCE_BOUNDS_MN, peak_mN)] += 1
        self._peaks_mN += max(0.0, peak_mN)

    def _take_timing(self, timing: Timing) -> None:
        service = timing.service
        if service not in self._missed:
            return
        self._missed[service].update(timing.missed, timing.epoch)
        for quantity in QUANTITIES:
            counted: Distribution = getattr(timing, quantity)
            self._durations[service, quantity].update(counted, timing.epoch)

    def update_status(self, status: Status) -> None:
        """Update the counters from a program's status."""
        with self._lock:
            if status.service in self._refused:
                self._refused[status.service].update(status.refused, status.instance)
            if status.instrument is not None and status.service in WITH_INSTRUMENT:
                for kind in INSTRUMENT_KINDS:
                    count: int = getattr(status.instrument, kind)
                    self._instrument[status.service, kind].update(count, status.instance)
            if status.service == "recorder":
                self.lost.update(status.missed, status.instance)

    def note_gone(self, service: str) -> None:
        """Count the disappearance of a program from the bus."""
        with self._lock:
            self._gone[service] += 1

    def gone(self) -> dict[str, int]:
        """Return the number of disappearances of each program from the bus."""
        with self._lock:
            return {service: self._gone[service] for service in OBSERVED}

    def trips(self) -> dict[Cause, int]:
        """Return trips of the actuator, by cause."""
        with self._lock:
            return {cause: self._trips[cause] for cause in CAUSES}

    def gaps(self) -> dict[str, int]:
        """Return the number of missing sequence numbers, by topic."""
        with self._lock:
            return {topic.name: self._gaps[topic.name] for topic in NUMBERED}

    def missed(self) -> dict[str, int]:
        """Return the number of ticks that each program of the loop has missed."""
        with self._lock:
            return {service: count.total for service, count in self._missed.items()}

    def refused(self) -> dict[str, int]:
        """Return the number of messages that each program has rejected."""
        with self._lock:
            return {service: count.total for service, count in self._refused.items()}

    def instrument(self) -> dict[tuple[str, str], int]:
        """Return the number of failed exchanges with instruments, by service and kind."""
        with self._lock:
            return {pair: count.total for pair, count in self._instrument.items()}

    def durations(self, service: str, quantity: str) -> Durations:
        """Return lateness, age or execution time of a program of the loop."""
        with self._lock:
            found = self._durations[service, quantity]
            return Durations(tuple(accumulate(found.counts())), found.sum_s)

    def ages(self) -> Distribution:
        """Return the distribution of the age of commands when the actuator accepted them."""
        with self._lock:
            return self._ages.distribution()

    def command_ages(self) -> Durations:
        """Return the histogram, over ``BOUNDS_S``, of the age of commands when the actuator
        accepted them.
        """
        with self._lock:
            counted, sum_s = self._ages.distribution(), self._ages_s
        ages = MonotonicHistogram()
        ages.update(counted)
        return Durations(tuple(accumulate(ages.counts())), sum_s)

    def peaks(self) -> Peaks:
        """Return the peak forces."""
        with self._lock:
            newest = None if self._peak is None else self._peak[1]
            return Peaks(newest, tuple(accumulate(self._peaks)), self._peaks_mN)


NUMBERED = tuple(TOPIC_OF[kind] for kind in (Position, Estimate, Command, Telemetry, Applied))


def _trip_of(applied: Applied) -> TripReason | None:
    """Return the present trip of the actuator; None without a trip."""
    return reason_of(applied) if applied.state in TRIPPED else None
