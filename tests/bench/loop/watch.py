"""Instruments that measure the length of ticks, or reply without a plant."""

from collections.abc import Callable
from itertools import cycle, pairwise
from time import monotonic, perf_counter, sleep

from pincette.sim.instruments.keyence_commands import value
from pincette.sim.plant.noise import GaussianNoise

Answer = Callable[[bytes], bytes | None]
WARM_UP = 300
NOISES = 997
BLOCK_LIMIT_S = 60.0


class Stopwatch:
    """An instrument that records the time of each request, and passes it to the real one or sends a
    blank reply."""

    def __init__(self, answer: Callable[[bytes], bytes | None]) -> None:
        self._answer = answer
        self.asked_s: list[float] = []

    def answer(self, line: bytes) -> bytes | None:
        """Note the time of a measurement; it begins a tick."""
        if line.startswith(b"MS"):
            self.asked_s.append(perf_counter())
        return self._answer(line)

    def idle(self) -> None:
        """Do nothing: there is no plant to update."""

    def ticks_s(self) -> list[float]:
        """Return the lengths of the ticks since the last call, without the warm-up."""
        times, self.asked_s = self.asked_s, []
        return [later - sooner for sooner, later in pairwise(times)][WARM_UP:]


def at_rest(noise_um: float, sensor: Answer) -> Answer:
    """Simulate a sensor in front of an arm at rest: its noise is repeated, without a plant."""
    noise = GaussianNoise(1)
    shown = cycle([b"MS,01," + value(noise_um * noise.at(tick), "um") for tick in range(NOISES)])
    return lambda line: next(shown) if line.startswith(b"MS") else sensor(line)


def obeyed(output: Answer) -> Answer:
    """Simulate an output that accepts each voltage and moves nothing."""
    return lambda line: b">" if line.startswith(b"#") else output(line)


def blank(line: bytes) -> bytes | None:
    """Return the reply of an instrument without a plant."""
    return b"MS,01,+0030.02" if line.startswith(b"MS") else b">"


def wait(done: Callable[[], bool], what: str) -> None:
    """Wait for the end of a block; raises TimeoutError."""
    deadline = monotonic() + BLOCK_LIMIT_S
    while not done():
        if monotonic() > deadline:
            raise TimeoutError(f"the {what} did not end within {BLOCK_LIMIT_S:g} s")
        sleep(0.01)
