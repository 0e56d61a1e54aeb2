"""The metrics of all rigs for Prometheus; no program is asked for them."""

from collections.abc import Iterator, Sequence
from itertools import product
from math import nan

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
from pincette_supervisor.metrics import families
from pincette_supervisor.metrics.families import Family
from pincette_supervisor.rigs.counters import (
    BOUNDS_S,
    FORCE_BOUNDS_MN,
    NUMBERED,
    OBSERVED,
    Durations,
)
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.rigs.standing import standing

MOST_RIGS = 64
"""Rigs that are exported; labels have fixed sets, so this bounds the number of series."""
ASKED_S = 10.0
"""How long an unanswered status request counts against a program's token."""
N_PER_MN = 1e-3
PARTS = tuple(
    dict.fromkeys(
        ("unknown" if certainty == "unknown" else reported, certainty)
        for reports in PART.values()
        for reported, row in reports.items()
        for certainty in row.values()
    )
)
"""All pairs of a part and its certainty."""


class RigCollector:
    """A collector for ``prometheus_client``."""

    def __init__(self, rigs: Rigs) -> None:
        self._rigs = rigs

    def collect(self) -> Iterator[Metric]:
        """All metrics, each for all rigs."""
        every = self._rigs.all()
        exported = every[:MOST_RIGS]
        yield _metric(families.BUILD, [((__version__,), 1)])
        yield _metric(families.UNUSABLE, [((), len(self._rigs.unusable))])
        yield _metric(families.LEFT_OUT, [((), len(every) - len(exported))])
        stood_s, spent_s = ATTENTION.totals()
        shares = [(("stood",), stood_s), *(((share,), each) for share, each in spent_s.items())]
        yield _metric(families.SUPERVISOR, shares)
        for manager in exported:
            _update_statuses(manager.context)
        yield from self._states(exported)
        yield from _counts(exported)
        yield from _durations(exported)
        yield from _peaks(exported)

    def _states(self, exported: Sequence[JobManager]) -> Iterator[Metric]:
        yield _metric(
            families.UP,
            [
                ((one.name, service), _up(one.context, service))
                for one, service in product(exported, OBSERVED)
            ],
        )
        yield _metric(families.LATCHED, [((one.name,), _latched(one.context)) for one in exported])
        yield from _standing(exported)
        yield _metric(
            families.QUEUE_HALTED, [((one.name,), bool(one.queue.halted)) for one in exported]
        )
        try:
            counted = self._rigs.store.counted()
        except StoreError:
            return  # all else is known without the journal
        yield _metric(
            families.JOBS,
            [
                ((one.name, kind, state), counted.get((one.name, kind, state), 0))
                for one, kind, state in product(exported, job_kinds(), STATES)
            ],
        )


def _update_statuses(context: RigContext) -> None:
    for answer in (*context.health.statuses.values(), context.health.simulation):
        if isinstance(answer, Status):
            context.observer.counters.update_status(answer)


def _up(context: RigContext, service: str) -> bool:
    """Whether a program's token is seen and its last status request was answered."""
    age_s = context.health.asked_age_s
    silent = isinstance(context.health.statuses.get(service), str)
    return context.observer.alive(service) and not (
        silent and age_s is not None and age_s < ASKED_S
    )


def _latched(context: RigContext) -> bool:
    if context.health.latched() is not None:
        return True
    return context.health.latch().mode in (Mode.FROZEN, Mode.RAMPING)


def _standing(exported: Sequence[JobManager]) -> Iterator[Metric]:
    stands = [(one.name, standing(one.context)) for one in exported]
    heard_s = [((rig,), nan if one.state_age_s is None else one.state_age_s) for rig, one in stands]
    yield _metric(families.HEARD, heard_s)
    parts: list[tuple[tuple[str, ...], float]] = []
    for rig, one in stands:
        told = (one.part, one.part_certainty)
        parts += [((rig, *pair), pair == told) for pair in PARTS]
    yield _metric(families.PART, parts)
    yield _metric(families.STROKE, [((one.name,), _stroke_change(one.context)) for one in exported])


def _stroke_change(context: RigContext) -> float:
    estimate = context.observer.newest(Estimate)
    change = None if estimate is None else estimate.arms[0].stroke_change
    return nan if change is None else change


def _counts(exported: Sequence[JobManager]) -> Iterator[Metric]:
    of = [(one.name, one.context.observer.counters) for one in exported]
    yield _metric(
        families.TRIPS,
        [((rig, cause.value), n) for rig, counters in of for cause, n in counters.trips().items()],
    )
    yield _metric(
        families.MISSED,
        [((rig, service), n) for rig, counters in of for service, n in counters.missed().items()],
    )
    yield _metric(
        families.GONE,
        [((rig, service), n) for rig, counters in of for service, n in counters.gone().items()],
    )
    yield _metric(
        families.ZERO_RETURNS,
        [
            ((rig, "true" if verified else "false"), n)
            for rig, counters in of
            for verified, n in counters.zero_returns().items()
        ],
    )
    yield _metric(families.UNANSWERED, [((rig,), counters.unanswered) for rig, counters in of])
    yield _metric(families.DEGRADED, [((rig,), counters.degraded) for rig, counters in of])
    dropped: list[tuple[tuple[str, ...], int]] = [
        ((one.name, "supervisor", "refused"), one.context.bus.refused.count) for one in exported
    ]
    for rig, counters in of:
        gaps: dict[str, int] = dict.fromkeys(LOOP, 0)
        for topic in NUMBERED:
            gaps[topic.producer] += counters.gaps()[topic.name]
        dropped += [((rig, service, "gap"), n) for service, n in gaps.items()]
        dropped += [((rig, service, "refused"), n) for service, n in counters.refused().items()]
        dropped.append(((rig, "recorder", "record"), counters.lost.total))
    yield _metric(families.DROPPED, dropped)
    yield _metric(
        families.INSTRUMENT,
        [((rig, *pair), n) for rig, counters in of for pair, n in counters.instrument().items()],
    )
    yield _metric(
        families.EXCHANGES,
        [
            ((one.name, service, str(arm), statistic), value)
            for one in exported
            for service, times in one.context.health.exchanges().items()
            for arm, took in enumerate(times, start=1)
            for statistic, value in (
                ("minimum", took.minimum_s),
                ("median", took.median_s),
                ("worst", took.worst_s),
            )
        ],
    )


def _durations(exported: Sequence[JobManager]) -> Iterator[Metric]:
    for family, quantity in (
        (families.LATENESS, "lateness"),
        (families.AGE, "age"),
        (families.EXECUTION, "execution"),
    ):
        metric = _histogram(family)
        for one, service in product(
            (one for one in exported if not one.context.rig.lockstep), LOOP
        ):
            durations = one.context.observer.counters.durations(service, quantity)
            _add_durations(metric, (one.name, service), durations)
        yield metric
    ages = _histogram(families.COMMAND_AGE)
    for one in exported:
        _add_durations(ages, (one.name,), one.context.observer.counters.command_ages())
    yield ages


def _peaks(exported: Sequence[JobManager]) -> Iterator[Metric]:
    newest: list[tuple[tuple[str, ...], float]] = []
    over = _histogram(families.PEAKS)
    for one in exported:
        peaks = one.context.observer.counters.peaks()
        if peaks.newest_mN is not None:
            newest.append(((one.name,), N_PER_MN * peaks.newest_mN))
        bounds_N = [N_PER_MN * bound_mN for bound_mN in FORCE_BOUNDS_MN]
        over.add_metric((one.name,), _buckets(bounds_N, peaks.counts), N_PER_MN * peaks.sum_mN)
    yield _metric(families.PEAK, newest)
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


def _metric(family: Family, found: Sequence[tuple[tuple[str, ...], float]]) -> Metric:
    kind = CounterMetricFamily if family.kind == "counter" else GaugeMetricFamily
    metric = kind(family.name, family.meaning, labels=family.labels)
    for labels, value in found:
        metric.add_metric(labels, float(value))
    return metric
