"""Measures a machine: wake-ups at several periods one after another, then hops over its bus."""

import json
import os
import platform
import socket
import subprocess
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from math import fsum, sqrt
from pathlib import Path
from typing import Any

from pincette.config.programs import Scheduling
from pincette.engine.measuring.hops import HOST, MATCHED_S
from pincette.engine.measuring.load import load
from pincette.engine.measuring.worker import command
from pincette.latency.histogram import Distribution
from pincette.latency.rule import Measured

PERIODS_S = (0.02, 0.01, 0.005, 0.002, 0.001)
HOPS_SHARE = 0.2
"""Share of the time that is used for the hops."""
START_S = 60.0
"""Longest time that a program takes to start and to end on a busy machine, in s."""
Progress = Callable[[str, float], None]
"""Function called with what is measured next, and for how long."""


class MeasuringError(Exception):
    """Error if the machine could not be measured; the text gives the reason."""


@dataclass(frozen=True, slots=True)
class Findings:
    """Results of a measurement."""

    wake_ups: tuple[Measured, ...]
    hop: Distribution
    refused: str
    """Requested settings that the system does not permit, in words."""
    kernel: str
    processors: int
    stolen_s: float | None
    """Processor time that the machine's host used meanwhile; None if unknown."""
    loaded: bool


def measure(
    periods_s: Sequence[float],
    for_s: float,
    scheduling: Scheduling,
    progress: Progress,
    *,
    loaded: bool,
) -> Findings:
    """Measure for about ``for_s`` in all, in separate programs; raises MeasuringError."""
    hops_s, shares = HOPS_SHARE * for_s, _shares(periods_s)
    longest_s = for_s + START_S * (len(periods_s) + 2)
    stolen_s = _stolen_s()
    found: list[Measured] = []
    refused = ""
    with load(longest_s) if loaded else nullcontext():
        for period_s, share in zip(periods_s, shares, strict=True):
            each_s = share * (for_s - hops_s)
            progress(f"wake-ups each {1e3 * period_s:g} ms", each_s)
            refused, tree = _output_of(command(scheduling, "wake_ups", period_s, each_s), each_s)
            lateness = distribution(tree["lateness"])
            found.append(Measured(period_s, lateness, tree["missed"]))
        progress("hops over the bus", hops_s)
        hop = _hop(scheduling, hops_s)
    after_s = _stolen_s()
    return Findings(
        wake_ups=tuple(found),
        hop=hop,
        refused=refused,
        kernel=f"{platform.system()} {platform.release()} {platform.machine()}",
        processors=os.cpu_count() or 1,
        stolen_s=None if stolen_s is None or after_s is None else after_s - stolen_s,
        loaded=loaded,
    )


def _shares(periods_s: Sequence[float]) -> list[float]:
    """Return the fraction of the time for each period.

    A long period gets more time, but still fewer wake-ups, than a short one.
    """
    weights = [sqrt(period_s) for period_s in periods_s]
    whole = fsum(weights)
    return [weight / whole for weight in weights]


def _hop(scheduling: Scheduling, for_s: float) -> Distribution:
    asker, echo = _free_ports(2)
    with _running(command(scheduling, "echo", echo, asker, for_s + MATCHED_S + START_S)):
        _, tree = _output_of(command(scheduling, "hops", asker, for_s), for_s + MATCHED_S)
    return distribution(tree["hop"])


def _output_of(words: list[str], for_s: float) -> tuple[str, dict[str, Any]]:
    """Return the settings that a program was refused, and its results."""
    try:
        done = subprocess.run(
            words, capture_output=True, text=True, timeout=for_s + START_S, check=True
        )
    except subprocess.TimeoutExpired as error:
        raise MeasuringError(f"a program that measures has not ended: {error}") from error
    except subprocess.CalledProcessError as error:
        last = error.stderr.strip().rpartition("\n")[2]
        raise MeasuringError(f"a program that measures has failed: {last or error}") from error
    first, second = (json.loads(line) for line in done.stdout.splitlines())
    return first["refused"], second


@contextmanager
def _running(words: list[str]) -> Generator[None]:
    program = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        program.terminate()
        program.wait()


def distribution(tree: dict[str, Any]) -> Distribution:
    """Return a distribution from plain data; raises ValueError, KeyError or TypeError."""
    return Distribution(tuple(tree["buckets"]), tuple(tree["counts"]), tree["max_s"])


def _free_ports(count: int) -> list[int]:
    with ExitStack() as stack:
        probes = [stack.enter_context(socket.socket()) for _ in range(count)]
        for probe in probes:
            probe.bind((HOST, 0))
        return [probe.getsockname()[1] for probe in probes]


def _stolen_s() -> float | None:
    """Return the processor time that the machine's host has used since it started."""
    try:
        with Path("/proc/stat").open(encoding="ascii") as stream:
            return int(stream.readline().split()[8]) / os.sysconf("SC_CLK_TCK")
    except (OSError, IndexError, ValueError):
        return None
