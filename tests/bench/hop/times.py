"""CPU time of a hop and its parts, and of a fixed loop with which machines are compared."""

import gc
from collections.abc import Callable
from dataclasses import dataclass
from time import process_time

from pincette.core.codec import decode, encode
from tests.bench.hop.alone import Alone

ROUNDS = 15
LOOPS = 20_000
"""Multiplications of the fixed loop; about a millisecond."""


@dataclass(frozen=True, slots=True)
class Hop:
    """CPU time of a single service, in µs per tick."""

    whole_us: float
    decode_us: float
    step_us: float
    encode_us: float

    @property
    def join_us(self) -> float:
        """Time of the queue, joins, instrument and bookkeeping, which is the remainder."""
        return self.whole_us - self.decode_us - self.step_us - self.encode_us


def hop_of(alone: Alone) -> Hop:
    """Measure each part of a hop; returns the minimum of several runs."""
    inputs, outputs, step, steps = alone.inputs, alone.outputs, alone.service.step, alone.steps()

    def decode_all() -> None:
        for topic, payload in inputs:
            decode(topic.message, payload)

    def encode_all() -> None:
        for output in outputs:
            encode(output)

    def step_all() -> None:
        for arguments in steps:
            step(*arguments)

    def least_us(begin: Callable[[], Callable[[], None]]) -> float:
        return min(cpu_us(begin()) for _ in range(ROUNDS)) / alone.ticks

    return Hop(
        whole_us=least_us(alone.begun),
        decode_us=least_us(lambda: decode_all),
        step_us=least_us(lambda: step_all),
        encode_us=least_us(lambda: encode_all),
    )


def fixed_us() -> float:
    """Return the CPU time of the fixed loop with which machines are compared, the minimum of many
    runs."""
    return min(cpu_us(_fixed) for _ in range(10 * ROUNDS))


def cpu_us(work: Callable[[], None]) -> float:
    """Return the CPU time of a function in µs, without garbage collection."""
    gc.collect()
    gc.disable()
    begin_s = process_time()
    work()
    passed_s = process_time() - begin_s
    gc.enable()
    return 1e6 * passed_s


def _fixed() -> None:
    value = 1.0
    for _ in range(LOOPS):
        value = value * 1.0000001
