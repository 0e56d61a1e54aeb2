"""Punctuality and CPU time of some rigs during a period."""

from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, sleep

import numpy as np
import zenoh

from pincette.bus.session import open_session
from pincette.bus.topology import client_session
from pincette.core.topics import ROOT
from pincette.latency.histogram import Distribution, first_ns
from tests.bench.loop.machine import cpu_s, stolen_s
from tests.bench.realtime.rigs import Rig, numbers, rigs_up
from tests.bench.realtime.seconds import Seconds
from tests.support.histograms import merged
from tests.support.rigs import Tree
from tests.support.stalls import STALL_S, StallRecorder

SETTLED_S = 2.0
"""Time after the start before measuring; the programs' imports keep the processors busy until
then."""
SHARES = {"p50": 0.5, "p99": 0.99, "p999": 0.999, "max": 1.0}


@dataclass(frozen=True, slots=True)
class Measured:
    """Resources and delays of some rigs, all rigs together."""

    rigs: int
    listeners: int
    rate_hz: float
    seconds: float
    ticks: int
    missed: int
    """Points of the sensor's grid that were skipped, and samples on which a service did not act."""
    missed_undisturbed: int
    """Number of the ``missed`` points and samples in seconds without a recorded stall."""
    stalls: int
    """Number of times that a processor did not run, or ran something else, for more than 5 ms."""
    stolen_s: float
    age_ms: dict[str, float]
    """Age of the newest sample when the actuator acts on it, in ms."""
    lateness_ms: dict[str, float]
    """Lateness of the sensor's wake-ups relative to its grid, in ms."""
    deviation: float | None
    """R.m.s. deviation of the interval between two samples from the period, divided by the
    period."""
    deviation_undisturbed: float | None
    """R.m.s. deviation of that interval in seconds without a stall, divided by the period; None if
    there was no such second."""
    cores: dict[str, float]
    """Number of processors that a program kept busy, over all rigs."""


def measured(rigs: int, listeners: int, seconds: float, own: Tree) -> Measured:
    """Start rigs, run their loops for a time, and stop them; ``own``: see ``rigs_up``."""
    with (
        TemporaryDirectory() as folder,
        rigs_up(rigs, Path(folder), own) as up,
        listening(listeners, up[0]),
    ):
        sleep(SETTLED_S)
        period_s = up[0].file.rig.period_s
        for rig in up:
            rig.begin(seconds + SETTLED_S)
        each_second = Seconds(up)
        processes, stolen = numbers(up), stolen_s()
        with StallRecorder() as recorder:
            before, begin_s = _cpu(processes), monotonic()
            sleep(seconds)
            spent, passed_s = _cpu(processes), monotonic() - begin_s
        reported = [rig.timing() for rig in up]
        for rig, services in zip(up, reported, strict=True):
            for timing in services.values():
                each_second.note(rig.file.rig.name, timing)
        undisturbed = each_second.undisturbed(recorder, period_s)
        whole = merged(one["sensor"].lateness for one in reported)
        return Measured(
            rigs=rigs,
            listeners=listeners,
            rate_hz=1.0 / period_s,
            seconds=passed_s,
            ticks=sum(one["sensor"].seq + 1 for one in reported),
            missed=sum(timing.missed for one in reported for timing in one.values()),
            missed_undisturbed=sum(one.missed for one in undisturbed),
            stalls=sum(length_s > STALL_S for _, length_s in recorder.stalls),
            stolen_s=stolen_s() - stolen,
            age_ms=_spread(one["actuator"].age for one in reported),
            lateness_ms=_spread([whole]),
            deviation=_deviation(zip(whole.buckets, whole.counts, strict=True), period_s),
            deviation_undisturbed=_deviation(
                (
                    item
                    for one in undisturbed
                    if one.service == "sensor"
                    for item in one.lateness.items()
                ),
                period_s,
            ),
            cores={name: (spent[name] - before[name]) / passed_s for name in spent},
        )


def _cpu(processes: Mapping[str, Sequence[int]]) -> dict[str, float]:
    return {name: sum(cpu_s(one) for one in some) for name, some in processes.items()}


def _spread(parts: Iterable[Distribution]) -> dict[str, float]:
    whole = merged(parts)
    return {name: 1e3 * (whole.quantile_s(share) or 0.0) for name, share in SHARES.items()}


def _deviation(latenesses: Iterable[tuple[int, int]], period_s: float) -> float | None:
    """Return the standard deviation of the difference between two independent latenesses, divided
    by the period, from a histogram."""
    items = list(latenesses)
    if not items:
        return None
    middles_s = [5e-10 * (first_ns(bucket) + first_ns(bucket + 1)) for bucket, _ in items]
    variance = np.cov(middles_s, fweights=[count for _, count in items], ddof=0)
    return sqrt(2.0 * variance) / period_s


@contextmanager
def listening(count: int, rig: Rig) -> Generator[None]:
    """Connect clients to the router, each of which receives everything that the rig publishes."""
    place = client_session(rig.file.bus.host, rig.file.bus.port)
    with ExitStack() as stack:
        for number in range(count):
            session = stack.enter_context(open_session(place, f"listener {number}"))
            ring: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(1)
            session.declare_subscriber(f"{ROOT}/{rig.file.rig.name}/**", ring)
        yield
