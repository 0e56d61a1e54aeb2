"""The metrics of all rigs for Prometheus: a function for each of them.

The docstring of a function is the meaning of its metric. No program is asked for any of them.
"""

import inspect
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import nan
from typing import Any, Literal, NamedTuple, TypeVar

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)

from pincette import __version__
from pincette.api.job_kinds import job_kinds
from pincette.api.rig_states import PART
from pincette.api.states import STATES
from pincette.core.faults import Mode
from pincette.core.messages import Estimate, Status
from pincette.core.topics import LOOP
from pincette_supervisor.attention import ATTENTION
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.journal.database import StoreError
from pincette_supervisor.rigs.counters import (
    BOUNDS_S,
    FORCE_BOUNDS_MN,
    NUMBERED,
    OBSERVED,
    Durations,
    RigCounters,
)
from pincette_supervisor.rigs.standing import standing

MOST_RIGS = 64
"""Rigs that are exported; labels have fixed sets, so this bounds the number of series."""
ASKED_S = 10.0
"""Age from which an unanswered status request counts against a program's token."""
N_PER_MN = 1e-3
BOUNDS_N = tuple(N_PER_MN * bound_mN for bound_mN in FORCE_BOUNDS_MN)
REAL_TIME = "in real time"
PARTS = tuple(
    dict.fromkeys(
        ("unknown" if certainty == "unknown" else reported, certainty)
        for reports in PART.values()
        for reported, row in reports.items()
        for certainty in row.values()
    )
)
"""All pairs of a part and its certainty."""
Kind = Literal["counter", "gauge", "histogram"]
FAMILY_OF: dict[Kind, Any] = {
    "counter": CounterMetricFamily,
    "gauge": GaugeMetricFamily,
    "histogram": HistogramMetricFamily,
}


class Counted(NamedTuple):
    """A histogram."""

    bounds: Sequence[float]
    counts: Sequence[int]
    """Cumulative counts; the last one has no bound."""
    total: float


Readings = Iterable[tuple[tuple[str, ...], float | Counted]]
"""Values of the labels, each with the value of the metric."""


class Scrape(NamedTuple):
    """Data of one answer."""

    rigs: Rigs
    exported: Sequence[JobManager]
    left_out: int
    """Number of rigs that are served and not exported."""


@dataclass(frozen=True, slots=True)
class Family:
    """One metric."""

    name: str
    """Name as Prometheus stores it, with base units: seconds and newtons."""
    kind: Kind
    labels: tuple[str, ...]
    read: Callable[[Scrape], Readings]
    meaning: str
    where: str = ""
    """Address at which it is served, if not everywhere."""

    def metric(self, scrape: Scrape) -> Metric:
        """Return the metric with its present values; raises StoreError."""
        metric = FAMILY_OF[self.kind](self.name, self.meaning, labels=self.labels)
        for labels, value in self.read(scrape):
            if isinstance(value, Counted):
                names = [*(f"{bound:g}" for bound in value.bounds), "+Inf"]
                buckets = list(zip(names, map(float, value.counts), strict=True))
                metric.add_metric(labels, buckets, value.total)
            else:
                metric.add_metric(labels, float(value))
        return metric


class RigCollector:
    """A collector for ``prometheus_client``."""

    def __init__(self, rigs: Rigs) -> None:
        self._rigs = rigs

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics, each for all rigs; those of the journal if it can be read."""
        every = self._rigs.all()
        exported = every[:MOST_RIGS]
        for one in exported:
            health = one.context.health
            for answer in (*health.statuses.values(), health.simulation):
                if isinstance(answer, Status):
                    one.context.observer.counters.update_status(answer)
        scrape = Scrape(self._rigs, exported, len(every) - len(exported))
        for family in FAMILIES:
            try:
                metric = family.metric(scrape)
            except StoreError:
                continue
            yield metric


FAMILIES: list[Family] = []
"""All metrics, in the order of the functions below."""
R = TypeVar("R", bound=Callable[..., Readings])


def metric(kind: Kind, name: str, *labels: str) -> Callable[[R], R]:
    """Make a function that reads all rigs the metric of a name."""

    def add(read: R) -> R:
        FAMILIES.append(Family(name, kind, labels, read, _meaning(read)))
        return read

    return add


def metric_of_rig(kind: Kind, name: str, *labels: str, where: str = "") -> Callable[[R], R]:
    """Make a function that reads one rig a metric, whose first label is the name of the rig."""

    def add(read: R) -> R:
        def read_all(scrape: Scrape) -> Readings:
            for one in scrape.exported:
                for found, value in read(one):
                    yield (one.name, *found), value

        family = Family(name, kind, ("rig", *labels), read_all, _meaning(read), where)
        FAMILIES.append(family)
        return read

    return add


def _meaning(read: Callable[..., Readings]) -> str:
    text = " ".join((inspect.getdoc(read) or "").split())
    return (text[:1].lower() + text[1:]).removesuffix(".")


def _counters(one: JobManager) -> RigCounters:
    return one.context.observer.counters


@metric("gauge", "pincette_build_info", "version")
def build(_: Scrape) -> Readings:
    """1; the supervisor's version."""
    yield (__version__,), 1


@metric_of_rig("gauge", "pincette_service_up", "service")
def up(one: JobManager) -> Readings:
    """1 where a program's token is seen and it has answered when it was last asked."""
    health, observer = one.context.health, one.context.observer
    age_s = health.asked_age_s
    asked = age_s is not None and age_s < ASKED_S
    for service in OBSERVED:
        silent = asked and isinstance(health.statuses.get(service), str)
        yield (service,), observer.alive(service) and not silent


@metric("gauge", "pincette_rigs_unusable")
def unusable(scrape: Scrape) -> Readings:
    """Rigs that were found and are not served."""
    yield (), len(scrape.rigs.unusable)


@metric("gauge", "pincette_rigs_left_out")
def left_out(scrape: Scrape) -> Readings:
    """Rigs served beyond those told of here."""
    yield (), scrape.left_out


@metric_of_rig("gauge", "pincette_latched")
def latched(one: JobManager) -> Readings:
    """1 where a person must reset the rig before it moves."""
    health = one.context.health
    known = health.latched() is not None
    yield (), known or health.latch().mode in (Mode.FROZEN, Mode.RAMPING)


@metric_of_rig("gauge", "pincette_actuator_heard_age_seconds")
def heard(one: JobManager) -> Readings:
    """Since the actuator was heard; NaN where it never was."""
    age_s = standing(one.context).state_age_s
    yield (), nan if age_s is None else age_s


@metric_of_rig("gauge", "pincette_part", "part", "certainty")
def part(one: JobManager) -> Readings:
    """1 for what is told of the part, and how far it can be trusted; 0 for all else."""
    stands = standing(one.context)
    for pair in PARTS:
        yield pair, pair == (stands.part, stands.part_certainty)


@metric_of_rig("gauge", "pincette_stroke_change_ratio")
def stroke(one: JobManager) -> Readings:
    """Change of the first arm's stroke since its calibration; NaN where it was not compared."""
    estimate = one.context.observer.newest(Estimate)
    change = None if estimate is None else estimate.arms[0].stroke_change
    yield (), nan if change is None else change


@metric_of_rig("counter", "pincette_trips_total", "cause")
def trips(one: JobManager) -> Readings:
    """Trips of the actuator."""
    for cause, count in _counters(one).trips().items():
        yield (cause.value,), count


@metric_of_rig("histogram", "pincette_lateness_seconds", "service", where=REAL_TIME)
def lateness(one: JobManager) -> Readings:
    """Sensor, actuator: wake-ups against their own grid; estimator, controller: arrival of their
    samples.
    """
    return _durations(one, "lateness")


@metric_of_rig("histogram", "pincette_tick_age_seconds", "service", where=REAL_TIME)
def age(one: JobManager) -> Readings:
    """From the first arrival of a sample's number to the step with what the program acts on."""
    return _durations(one, "age")


@metric_of_rig("histogram", "pincette_execution_seconds", "service", where=REAL_TIME)
def execution(one: JobManager) -> Readings:
    """Of a step until all was told, instruments included."""
    return _durations(one, "execution")


def _durations(one: JobManager, quantity: str) -> Readings:
    if not one.context.rig.lockstep:
        for service in LOOP:
            yield (service,), _counted(_counters(one).durations(service, quantity))


def _counted(durations: Durations) -> Counted:
    return Counted(BOUNDS_S, durations.counts, durations.sum_s)


@metric_of_rig("histogram", "pincette_command_age_seconds")
def command_age(one: JobManager) -> Readings:
    """Age of the commands that the actuator took; its limit trips the rig."""
    yield (), _counted(_counters(one).command_ages())


@metric_of_rig("counter", "pincette_missed_ticks_total", "service", where=REAL_TIME)
def missed(one: JobManager) -> Readings:
    """Samples and points of the grid that a program has skipped."""
    for service, count in _counters(one).missed().items():
        yield (service,), count


@metric_of_rig("counter", "pincette_unanswered_ticks_total")
def unanswered(one: JobManager) -> Readings:
    """Ticks of an armed actuator without a command that it took."""
    yield (), _counters(one).unanswered


@metric_of_rig("counter", "pincette_degraded_estimates_total")
def degraded(one: JobManager) -> Readings:
    """Estimates made without the voltage of the sample before."""
    yield (), _counters(one).degraded


@metric_of_rig("counter", "pincette_dropped_total", "service", "kind")
def dropped(one: JobManager) -> Readings:
    """`gap`: numbers that lacked between two samples of an armed loop, as the supervisor heard
    them; `refused`: messages and commands that the program refused; `record`: messages that the
    records lack.
    """
    counters = _counters(one)
    gaps: dict[str, int] = dict.fromkeys(LOOP, 0)
    for topic in NUMBERED:
        gaps[topic.producer] += counters.gaps()[topic.name]
    yield ("supervisor", "refused"), one.context.bus.refused.count
    for service, count in gaps.items():
        yield (service, "gap"), count
    for service, count in counters.refused().items():
        yield (service, "refused"), count
    yield ("recorder", "record"), counters.lost.total


@metric_of_rig("counter", "pincette_instrument_exchanges_total", "service", "kind")
def instrument(one: JobManager) -> Readings:
    """Exchanges with instruments that went wrong. `late`: answers that came after their timeout,
    and were dropped; `lost`: answers that never came; `unexpected`: answers more than requests;
    `reopened`: ports opened again; `retried`: attempts repeated when an instrument was opened.
    """
    return _counters(one).instrument().items()


@metric_of_rig("gauge", "pincette_instrument_exchange_seconds", "service", "arm", "statistic")
def exchanges(one: JobManager) -> Readings:
    """`minimum`, `median` and `worst` duration of the newest 40 exchanges with an instrument that
    succeeded: readings of the sensor's program, writes and questions of the actuator's.
    """
    for service, times in one.context.health.exchanges().items():
        for arm, took in enumerate(times, start=1):
            yield (service, str(arm), "minimum"), took.minimum_s
            yield (service, str(arm), "median"), took.median_s
            yield (service, str(arm), "worst"), took.worst_s


@metric_of_rig("counter", "pincette_programs_gone_total", "service")
def gone(one: JobManager) -> Readings:
    """Times that a program was no longer seen on the bus: it ended, or a link on the way did; each
    program logs its own links.
    """
    for service, count in _counters(one).gone().items():
        yield (service,), count


@metric_of_rig("gauge", "pincette_force_peak_newtons")
def newest_peak(one: JobManager) -> Readings:
    """Highest estimated contact force of the newest arming that had any."""
    newest_mN = _counters(one).peaks().newest_mN
    if newest_mN is not None:
        yield (), N_PER_MN * newest_mN


@metric_of_rig("histogram", "pincette_arming_force_peak_newtons")
def peaks(one: JobManager) -> Readings:
    """The same of every arming that is over, so that none is missed between two scrapes."""
    found = _counters(one).peaks()
    yield (), Counted(BOUNDS_N, found.counts, N_PER_MN * found.sum_mN)


@metric_of_rig("counter", "pincette_zero_returns_total", "verified")
def zero_returns(one: JobManager) -> Readings:
    """Jobs whose arm came back free to the place of its zero; `false` where the force read there
    was beyond its uncertainty.
    """
    for verified, count in _counters(one).zero_returns().items():
        yield ("true" if verified else "false",), count


@metric("gauge", "pincette_jobs", "rig", "kind", "state")
def jobs(scrape: Scrape) -> Readings:
    """Jobs in the journal."""
    counted = scrape.rigs.store.counted()
    for one, kind, state in product(scrape.exported, job_kinds(), STATES):
        yield (one.name, kind, state), counted.get((one.name, kind, state), 0)


@metric_of_rig("gauge", "pincette_queue_halted")
def queue_halted(one: JobManager) -> Readings:
    """1 where the queue waits for a person."""
    yield (), bool(one.queue.halted)


@metric("counter", "pincette_supervisor_seconds_total", "share")
def supervisor(_: Scrape) -> Readings:
    """Where the supervisor's time goes: `stood`, nothing of it ran; `bus`, messages; `journal`,
    writes; `drawing`; the shares overlap.
    """
    stood_s, spent_s = ATTENTION.totals()
    yield ("stood",), stood_s
    for share, each_s in spent_s.items():
        yield (share,), each_s
