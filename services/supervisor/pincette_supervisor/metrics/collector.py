"""The metrics of all rigs at the moment somebody asks; nobody else is asked for them."""

from collections.abc import Iterator, Sequence
from itertools import product
from typing import get_args

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)

from pincette import __version__
from pincette.api.job_models import JobKind
from pincette.api.states import STATES
from pincette.messages import Status
from pincette.topics import LOOP
from pincette_supervisor.journal.base import StoreError
from pincette_supervisor.metrics import families
from pincette_supervisor.metrics.families import Family
from pincette_supervisor.metrics.rising import BOUNDS_S
from pincette_supervisor.metrics.tally import FORCE_BOUNDS_MN, NUMBERED, OBSERVED, Durations
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.rigs import Rigs
from pincette_supervisor.running.site import Site

MOST_RIGS = 64
"""Rigs that are told of: with the labels, of which each has a fixed set, they bound the series."""
ASKED_S = 10.0
"""How long what a program answered speaks against its token."""
N_PER_MN = 1e-3
KINDS = get_args(JobKind)


class RigCollector:
    """What Prometheus is told; a collector as its client library wants them."""

    def __init__(self, rigs: Rigs) -> None:
        self._rigs = rigs

    def collect(self) -> Iterator[Metric]:
        """Every metric, each with all rigs."""
        every = self._rigs.all()
        told = every[:MOST_RIGS]
        yield _gauge(families.BUILD, [((__version__,), 1)])
        yield _gauge(families.UNUSABLE, [((), len(self._rigs.unusable))])
        yield _gauge(families.LEFT_OUT, [((), len(every) - len(told))])
        for conductor in told:
            _take_answers(conductor.site)
        yield from self._states(told)
        yield from _counts(told)
        yield from _durations(told)
        yield from _peaks(told)

    def _states(self, told: Sequence[Conductor]) -> Iterator[Metric]:
        yield _gauge(
            families.UP,
            [
                ((one.name, service), _up(one.site, service))
                for one, service in product(told, OBSERVED)
            ],
        )
        yield _gauge(families.LATCHED, [((one.name,), _latched(one.site)) for one in told])
        yield _gauge(families.QUEUE_HALTED, [((one.name,), bool(one.queue.halted)) for one in told])
        try:
            counted = self._rigs.store.counted()
        except StoreError:
            return  # all else is known without the journal
        yield _gauge(
            families.JOBS,
            [
                ((one.name, kind, state), counted.get((one.name, kind, state), 0))
                for one, kind, state in product(told, KINDS, STATES)
            ],
        )


def _take_answers(site: Site) -> None:
    for answer in site.health.statuses.values():
        if isinstance(answer, Status):
            site.observer.tally.asked(answer)


def _up(site: Site, service: str) -> bool:
    """Whether a program lives, and does not hang as far as it was asked lately."""
    age_s = site.health.asked_age_s
    silent = isinstance(site.health.statuses.get(service), str)
    return site.observer.alive(service) and not (silent and age_s is not None and age_s < ASKED_S)


def _latched(site: Site) -> bool:
    return bool(site.health.latched()) or site.health.latch()[0] in ("frozen", "ramping")


def _counts(told: Sequence[Conductor]) -> Iterator[Metric]:
    of = [(one.name, one.site.observer.tally) for one in told]
    yield _counter(
        families.TRIPS,
        [((rig, cause.value), n) for rig, tally in of for cause, n in tally.trips().items()],
    )
    yield _counter(
        families.MISSED,
        [((rig, service), n) for rig, tally in of for service, n in tally.missed().items()],
    )
    yield _counter(families.UNANSWERED, [((rig,), tally.unanswered()) for rig, tally in of])
    yield _counter(families.DEGRADED, [((rig,), tally.degraded()) for rig, tally in of])
    dropped: list[tuple[tuple[str, ...], int]] = []
    for rig, tally in of:
        gaps: dict[str, int] = dict.fromkeys(LOOP, 0)
        for topic in NUMBERED:
            gaps[topic.producer] += tally.gaps()[topic.name]
        dropped += [((rig, service, "gap"), n) for service, n in gaps.items()]
        dropped += [((rig, service, "refused"), n) for service, n in tally.refused().items()]
        dropped.append(((rig, "recorder", "record"), tally.lost()))
    yield _counter(families.DROPPED, dropped)


def _durations(told: Sequence[Conductor]) -> Iterator[Metric]:
    for family, quantity in (
        (families.LATENESS, "lateness"),
        (families.AGE, "age"),
        (families.EXECUTION, "execution"),
    ):
        metric = _histogram(family)
        for one, service in product((one for one in told if not one.site.rig.lockstep), LOOP):
            durations = one.site.observer.tally.durations(service, quantity)
            _add_durations(metric, (one.name, service), durations)
        yield metric
    ages = _histogram(families.COMMAND_AGE)
    for one in told:
        _add_durations(ages, (one.name,), one.site.observer.tally.command_ages())
    yield ages


def _peaks(told: Sequence[Conductor]) -> Iterator[Metric]:
    newest: list[tuple[tuple[str, ...], float]] = []
    over = _histogram(families.PEAKS)
    for one in told:
        peaks = one.site.observer.tally.peaks()
        if peaks.newest_mN is not None:
            newest.append(((one.name,), N_PER_MN * peaks.newest_mN))
        bounds_N = [N_PER_MN * bound_mN for bound_mN in FORCE_BOUNDS_MN]
        over.add_metric((one.name,), _buckets(bounds_N, peaks.counts), N_PER_MN * peaks.sum_mN)
    yield _gauge(families.PEAK, newest)
    yield over


def _add_durations(
    metric: HistogramMetricFamily, labels: Sequence[str], durations: Durations
) -> None:
    metric.add_metric(labels, _buckets(BOUNDS_S, durations.counts), durations.sum_s)


def _buckets(bounds: Sequence[float], counts: Sequence[int]) -> list[tuple[str, float]]:
    names = [*(f"{bound:g}" for bound in bounds), "+Inf"]
    return list(zip(names, map(float, counts), strict=True))


def _histogram(family: Family) -> HistogramMetricFamily:
    return HistogramMetricFamily(family.name, family.meaning, labels=family.labels)


def _gauge(family: Family, found: Sequence[tuple[tuple[str, ...], float]]) -> Metric:
    metric = GaugeMetricFamily(family.name, family.meaning, labels=family.labels)
    for labels, value in found:
        metric.add_metric(labels, float(value))
    return metric


def _counter(family: Family, found: Sequence[tuple[tuple[str, ...], float]]) -> Metric:
    metric = CounterMetricFamily(family.name, family.meaning, labels=family.labels)
    for labels, value in found:
        metric.add_metric(labels, float(value))
    return metric
