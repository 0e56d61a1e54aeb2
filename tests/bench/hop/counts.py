"""What a hop takes that no clock is needed for: the same on every machine with the same Python."""

import gc
import sys
import tracemalloc
from dataclasses import dataclass
from statistics import median
from types import FrameType

from pincette.core.codec import encode
from tests.bench.hop.alone import Alone


@dataclass(frozen=True, slots=True)
class Counts:
    """Of one service, a tick."""

    calls: float
    """Functions that are called, Python's own and built in."""
    kept_blocks: float
    """Blocks of memory that a tick leaves behind."""
    peak_bytes: float
    """Most memory that a tick takes on its way, beyond what it found."""
    said_bytes: float
    """Payload that leaves the service."""


def counts_of(alone: Alone) -> Counts:
    """Play the grip once for each count."""
    return Counts(
        calls=_calls(alone) / alone.ticks,
        kept_blocks=_kept_blocks(alone) / alone.ticks,
        peak_bytes=_peak_bytes(alone),
        said_bytes=sum(len(encode(output)) for output in alone.outputs) / alone.ticks,
    )


def _calls(alone: Alone) -> int:
    play, calls = alone.begun(), 0

    def count(_frame: FrameType, event: str, _argument: object) -> None:
        nonlocal calls
        if event in ("call", "c_call"):
            calls += 1

    sys.setprofile(count)
    try:
        play()
    finally:
        sys.setprofile(None)
    return calls


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
