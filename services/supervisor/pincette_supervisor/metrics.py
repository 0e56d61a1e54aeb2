"""Metrics of all rigs for Prometheus, with one function for each.

The docstring of a function is the description of its metric. No program is queried for any of them.
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
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.journal.database import StoreError
from pincette_supervisor.process_load import PROCESS_LOAD
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
"""Largest number of exported rigs.

The label sets are fixed, so this bounds the number of series.
"""
ASKED_S = 10.0
"""Longest age in s of a status request whose missing reply overrides the program's token."""
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
"""All pairs of a part state and its certainty."""
Kind = Literal["counter", "gauge", "histogram"]
FAMILY_OF: dict[Kind, Any] = {
    "counter": CounterMetricFamily,
    "gauge": GaugeMetricFamily,
    "histogram": HistogramMetricFamily,
}


class Counted(NamedTuple):
    """Values of a histogram."""

    bounds: Sequence[float]
    counts: Sequence[int]
    """Cumulative counts; the last one has no upper bound."""
    total: float


Readings = Iterable[tuple[tuple[str, ...], float | Counted]]
"""Pairs of label values and the metric's value for them."""


class Scrape(NamedTuple):
    """Data of one response to Prometheus."""

    rigs: Rigs
    exported: Sequence[JobManager]
    left_out: int
    """Number of rigs that are served but not exported."""


@dataclass(frozen=True, slots=True)
class Family:
    """Definition of one metric."""

    name: str
    """Name of the metric in Prometheus, with base units: seconds and newtons."""
    kind: Kind
    labels: tuple[str, ...]
    read: Callable[[Scrape], Readings]
    meaning: str
    where: str = ""
    """Address at which the metric is served; empty: everywhere."""

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
    """Collector for ``prometheus_client``."""

    def __init__(self, rigs: Rigs) -> None:
        self._rigs = rigs

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics, each for all rigs; those of the journal only if it can be read."""
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
    """Return a decorator that registers a function, which takes all rigs, as a named metric."""

    def add(read: R) -> R:
        FAMILIES.append(Family(name, kind, labels, read, _meaning(read)))
        return read

    return add


def metric_of_rig(kind: Kind, name: str, *labels: str, where: str = "") -> Callable[[R], R]:
    """Return a decorator that turns a function of one rig into a metric whose first label is the
    rig's name."""

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
    """Always 1; its label is the supervisor's version."""
    yield (__version__,), 1


@metric_of_rig("gauge", "pincette_service_up", "service")
def up(one: JobManager) -> Readings:
    """1 if a program's token is present and the program answered the last request."""
    health, observer = one.context.health, one.context.observer
    age_s = health.asked_age_s
    asked = age_s is not None and age_s < ASKED_S
    for service in OBSERVED:
        silent = asked and isinstance(health.statuses.get(service), str)
        yield (service,), observer.alive(service) and not silent


@metric("gauge", "pincette_rigs_unusable")
def unusable(scrape: Scrape) -> Readings:
    """Number of rigs that were found and are not served."""
    yield (), len(scrape.rigs.unusable)


@metric("gauge", "pincette_rigs_left_out")
def left_out(scrape: Scrape) -> Readings:
    """Number of served rigs that are not exported here."""
    yield (), scrape.left_out


@metric_of_rig("gauge", "pincette_latched")
def latched(one: JobManager) -> Readings:
    """1 if a person must reset the rig before it moves."""
    health = one.context.health
    known = health.latched() is not None
    yield (), known or health.latch().mode in (Mode.FROZEN, Mode.RAMPING)


@metric_of_rig("gauge", "pincette_actuator_heard_age_seconds")
def heard(one: JobManager) -> Readings:
    """Time since the last message of the actuator; NaN before the first one."""
    age_s = standing(one.context).state_age_s
    yield (), nan if age_s is None else age_s


@metric_of_rig("gauge", "pincette_part", "part", "certainty")
def part(one: JobManager) -> Readings:
    """1 for the present part state and its certainty; 0 for all other pairs."""
    stands = standing(one.context)
    for pair in PARTS:
        yield pair, pair == (stands.part, stands.part_certainty)


@metric_of_rig("gauge", "pincette_stroke_change_ratio")
def stroke(one: JobManager) -> Readings:
    """Change of the first arm's stroke since its calibration; NaN if it was not measured."""
    estimate = one.context.observer.newest(Estimate)
    change = None if estimate is None else estimate.arms[0].stroke_change
    yield (), nan if change is None else change


@metric_of_rig("counter", "pincette_trips_total", "cause")
def trips(one: JobManager) -> Readings:
    """Number of trips of the actuator."""
    for cause, count in _counters(one).trips().items():
        yield (cause.value,), count


@metric_of_rig("histogram", "pincette_lateness_seconds", "service", where=REAL_TIME)
def lateness(one: JobManager) -> Readings:
    """Lateness of wake-ups on the time grid (sensor, actuator), or of samples on arrival
    (estimator, controller).
    """
    return _durations(one, "lateness")


@metric_of_rig("histogram", "pincette_tick_age_seconds", "service", where=REAL_TIME)
def age(one: JobManager) -> Readings:
    """Time from the first arrival of a sample's number to the step that acts on it."""
    return _durations(one, "age")


@metric_of_rig("histogram", "pincette_execution_seconds", "service", where=REAL_TIME)
def execution(one: JobManager) -> Readings:
    """Duration of a step until all its messages are published, including instrument access."""
    return _durations(one, "execution")


def _durations(one: JobManager, quantity: str) -> Readings:
    if not one.context.rig.lockstep:
        for service in LOOP:
            yield (service,), _counted(_counters(one).durations(service, quantity))


def _counted(durations: Durations) -> Counted:
    return Counted(BOUNDS_S, durations.counts, durations.sum_s)


@metric_of_rig("histogram", "pincette_command_age_seconds")
def command_age(one: JobManager) -> Readings:
    """Age of the commands that the actuator accepted; beyond its limit the rig trips."""
    yield (), _counted(_counters(one).command_ages())


@metric_of_rig("counter", "pincette_missed_ticks_total", "service", where=REAL_TIME)
def missed(one: JobManager) -> Readings:
    """Number of samples and grid points that a program has skipped."""
    for service, count in _counters(one).missed().items():
        yield (service,), count


@metric_of_rig("counter", "pincette_unanswered_ticks_total")
def unanswered(one: JobManager) -> Readings:
    """Number of ticks of an armed actuator without an accepted command."""
    yield (), _counters(one).unanswered


@metric_of_rig("counter", "pincette_degraded_estimates_total")
def degraded(one: JobManager) -> Readings:
    """Number of estimates without the voltage of the preceding sample."""
    yield (), _counters(one).degraded


@metric_of_rig("counter", "pincette_dropped_total", "service", "kind")
def dropped(one: JobManager) -> Readings:
    """Lost messages. `gap`: sample numbers of an armed loop that did not reach the supervisor;
    `refused`: messages and commands that the program rejected; `record`: messages missing in
    the records.
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
    """Failed exchanges with instruments. `late`: replies that arrived after their timeout and
    were dropped; `lost`: replies that never arrived; `unexpected`: replies without a request;
    `reopened`: ports that were reopened; `retried`: repeated attempts to open an instrument.
    """
    return _counters(one).instrument().items()


@metric_of_rig("gauge", "pincette_instrument_exchange_seconds", "service", "arm", "statistic")
def exchanges(one: JobManager) -> Readings:
    """`minimum`, `median` and `worst` duration of the newest 40 successful exchanges with an
    instrument: readings of the sensor's program, writes and queries of the actuator's.
    """
    for service, times in one.context.health.exchanges().items():
        for arm, took in enumerate(times, start=1):
            yield (service, str(arm), "minimum"), took.minimum_s
            yield (service, str(arm), "median"), took.median_s
            yield (service, str(arm), "worst"), took.worst_s


@metric_of_rig("counter", "pincette_programs_gone_total", "service")
def gone(one: JobManager) -> Readings:
    """Number of times that a program disappeared from the bus: it ended, or a link to it was lost;
    each program logs its own links.
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
    """Distribution of the highest estimated contact forces of all finished armings, so that no peak
    is missed between two scrapes.
    """
    found = _counters(one).peaks()
    yield (), Counted(BOUNDS_N, found.counts, N_PER_MN * found.sum_mN)


@metric_of_rig("counter", "pincette_zero_returns_total", "verified")
def zero_returns(one: JobManager) -> Readings:
    """Number of jobs whose arm returned free to the position of its zero; `false` if the force
    read there exceeded its uncertainty.
    """
    for verified, count in _counters(one).zero_returns().items():
        yield ("true" if verified else "false",), count


@metric_of_rig("gauge", "pincette_strokes_since_calibration")
def strokes(one: JobManager) -> Readings:
    """Strokes of the arm in jobs since the last accepted calibration."""
    yield (), one.context.use.totals().strokes


@metric_of_rig("gauge", "pincette_contacts_since_calibration")
def contacts(one: JobManager) -> Readings:
    """Contacts with a part in jobs since the last accepted calibration."""
    yield (), one.context.use.totals().contacts


@metric_of_rig("gauge", "pincette_armed_seconds_since_calibration")
def armed(one: JobManager) -> Readings:
    """Time with the loop armed for jobs since the last accepted calibration."""
    yield (), one.context.use.totals().armed_s


@metric("gauge", "pincette_jobs", "rig", "kind", "state")
def jobs(scrape: Scrape) -> Readings:
    """Number of jobs in the journal."""
    counted = scrape.rigs.store.counted()
    for one, kind, state in product(scrape.exported, job_kinds(), STATES):
        yield (one.name, kind, state), counted.get((one.name, kind, state), 0)


@metric_of_rig("gauge", "pincette_queue_halted")
def queue_halted(one: JobManager) -> Readings:
    """1 if the queue waits for a person."""
    yield (), bool(one.queue.halted)


@metric("counter", "pincette_supervisor_seconds_total", "share")
def supervisor(_: Scrape) -> Readings:
    """Time of the supervisor by activity: `stood`, its process did not run; `bus`, messages;
    `journal`, writes; `drawing`; the activities overlap.
    """
    stood_s, spent_s = PROCESS_LOAD.totals()
    yield ("stood",), stood_s
    for share, each_s in spent_s.items():
        yield (share,), each_s
