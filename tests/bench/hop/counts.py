"""Costs of a hop that are counted without a clock: they are equal on all machines with the same
Python."""

import gc
import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from types import FrameType

from pincette.core.codec import encode
from tests.bench.hop.alone import Alone


@dataclass(frozen=True, slots=True)
class Counts:
    """Counts of one service, per tick."""

    calls: float
    """Number of functions called, in Python and built in."""
    calls_awaited: float
    """Number of the calls between the arrival of an input and the first message that it causes."""
    kept_blocks: float
    """Number of memory blocks that a tick leaves allocated."""
    peak_bytes: float
    """Largest memory that a tick allocates temporarily, in bytes."""
    said_bytes: float
    """Size of the payload that the service sends, in bytes."""


def counts_of(alone: Alone) -> Counts:
    """Play the grip once for each count."""
    return Counts(
        calls=_calls(alone) / alone.ticks,
        calls_awaited=_calls_awaited(alone) / alone.ticks,
        kept_blocks=_kept_blocks(alone) / alone.ticks,
        peak_bytes=_peak_bytes(alone),
        said_bytes=sum(len(encode(output)) for output in alone.outputs) / alone.ticks,
    )


def _calls(alone: Alone) -> int:
    calls = 0

    def called() -> None:
        nonlocal calls
        calls += 1

    _profiled(alone.begun(), called)
    return calls


def _calls_awaited(alone: Alone) -> int:
    since: int | None = None
    calls = awaited = 0

    def called() -> None:
        nonlocal calls
        calls += 1

    def came() -> None:
        nonlocal since
        since = calls

    def sent() -> None:
        nonlocal since, awaited
        if since is not None:
            awaited += calls - since - 1  # without the call of this function
            since = None

    _profiled(alone.begun(each=came, sent=sent), called)
    return awaited


def _profiled(play: Callable[[], None], called: Callable[[], None]) -> None:
    def count(_frame: FrameType, event: str, _argument: object) -> None:
        if event in ("call", "c_call"):
            called()

    sys.setprofile(count)
    try:
        play()
    finally:
        sys.setprofile(None)


def _kept_blocks(alone: Alone) -> int:
    play = alone.begun()
    gc.collect()
    before = sys.getallocatedblocks()
    play()
    return sys.getallocatedblocks() - before


def _peak_bytes(alone: Alone) -> float:
    peaks: list[int] = []
    begin = 0

    def noted() -> None:
        nonlocal begin
        if begin:
            peaks.append(tracemalloc.get_traced_memory()[1] - begin)
        tracemalloc.reset_peak()
        begin, _ = tracemalloc.get_traced_memory()

    play = alone.begun(each=noted)
    tracemalloc.start()
    try:
        play()
    finally:
        tracemalloc.stop()
    return median(peaks)
