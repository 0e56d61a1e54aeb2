"""A loop or ring that passes ticks on, and the figures of a block of ticks."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from tests.bench.loop.machine import cpu_of, stolen_s
from tests.bench.loop.watch import Stopwatch


@dataclass(frozen=True, slots=True)
class Block:
    """Figures of a number of consecutive ticks."""

    ticks_s: list[float]
    cpu_us: dict[str, float]
    """CPU time of each process per tick; ``instruments`` is that of the instruments."""
    stolen_s: float

    @property
    def per_s(self) -> float:
        """Ticks per second."""
        return len(self.ticks_s) / sum(self.ticks_s)


@dataclass(frozen=True, slots=True)
class Contestant:
    """A running loop or ring."""

    name: str
    run: Callable[[int], None]
    """Pass a number of ticks on, and return after the last one."""
    watch: Stopwatch
    processes: Mapping[str, int]
    """Process number by role."""
    blocks: list[Block] = field(default_factory=list[Block])

    def measure(self, ticks: int) -> None:
        """Run one block and store its figures."""
        before, stolen = cpu_of(self.processes), stolen_s()
        self.run(ticks)
        spent = {
            name: 1e6 * (later_s - before[name]) / ticks
            for name, later_s in cpu_of(self.processes).items()
        }
        self.blocks.append(Block(self.watch.ticks_s(), spent, stolen_s() - stolen))
