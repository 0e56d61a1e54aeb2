"""Something that turns over ticks, and what is noted of a block of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from tests.bench.loop.machine import cpu_of, stolen_s
from tests.bench.loop.watch import Stopwatch


@dataclass(frozen=True, slots=True)
class Block:
    """Some ticks in a row."""

    ticks_s: list[float]
    cpu_us: dict[str, float]
    """CPU time of each process, a tick, and of the instruments' own as ``instruments``."""
    stolen_s: float

    @property
    def per_s(self) -> float:
        """Ticks per second."""
        return len(self.ticks_s) / sum(self.ticks_s)


@dataclass(frozen=True, slots=True)
class Contestant:
    """A loop or a ring that is up."""

    name: str
    run: Callable[[int], None]
    """Turns over a number of ticks, and returns when they are over."""
    watch: Stopwatch
    processes: Mapping[str, int]
    """By role, the number of the process."""
    blocks: list[Block] = field(default_factory=list[Block])

    def measure(self, ticks: int) -> None:
        """Run one block and keep it."""
        before, stolen = cpu_of(self.processes), stolen_s()
        self.run(ticks)
        spent = {
            name: 1e6 * (later_s - before[name]) / ticks
            for name, later_s in cpu_of(self.processes).items()
        }
        self.blocks.append(Block(self.watch.ticks_s(), spent, stolen_s() - stolen))
