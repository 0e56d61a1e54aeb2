"""An instrument that times the ticks, and one that says nothing new."""

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
    """An instrument that notes when it is asked, and hands on to the real one or answers blank."""

    def __init__(self, answer: Callable[[bytes], bytes | None]) -> None:
        self._answer = answer
        self.asked_s: list[float] = []

    def answer(self, line: bytes) -> bytes | None:
        """Note the time of a measurement; it begins a tick."""
        if line.startswith(b"MS"):
            self.asked_s.append(perf_counter())
        return self._answer(line)

    def idle(self) -> None:
        """Nothing to look after."""

    def ticks_s(self) -> list[float]:
        """Lengths of the ticks since the last call, the warm-up left out."""
        times, self.asked_s = self.asked_s, []
        return [later - sooner for sooner, later in pairwise(times)][WARM_UP:]


def at_rest(noise_um: float, sensor: Answer) -> Answer:
    """A sensor before an arm that rests: its noise over and over, without a plant to ask."""
    noise = GaussianNoise(1)
    shown = cycle([b"MS,01," + value(noise_um * noise.at(tick), "um") for tick in range(NOISES)])
    return lambda line: next(shown) if line.startswith(b"MS") else sensor(line)


def obeyed(output: Answer) -> Answer:
    """An output that takes each voltage, and moves nothing."""
    return lambda line: b">" if line.startswith(b"#") else output(line)


def blank(line: bytes) -> bytes | None:
    """What an instrument without a plant says."""
    return b"MS,01,+0030.02" if line.startswith(b"MS") else b">"


def wait(done: Callable[[], bool], what: str) -> None:
    """Wait for the end of a block; raises TimeoutError."""
    deadline = monotonic() + BLOCK_LIMIT_S
    while not done():
        if monotonic() > deadline:
            raise TimeoutError(f"the {what} did not end within {BLOCK_LIMIT_S:g} s")
        sleep(0.01)
