"""What programs that tick ask of the operating system, so that they run when they are due."""

from dataclasses import dataclass
from typing import Annotated, Literal, cast

from pydantic import Field

from pincette.config.tables import Table

Ticking = Literal["router", "rig", "sensor", "estimator", "controller", "actuator"]
"""Programs that a tick passes through."""
Wish = Literal["priority", "cores", "timer_slack", "memory"]
PRIORITY = 10
"""Above every fair task, below the threads of the kernel."""
Priority = Annotated[int, Field(ge=0, le=99)]
Core = Annotated[int, Field(ge=0, le=1023)]
Cores = Annotated[tuple[Core, ...], Field(max_length=1024, strict=False)]


@dataclass(frozen=True, slots=True)
class Wishes:
    """What one program asks for."""

    priority: int = PRIORITY
    """SCHED_FIFO; 0: none."""
    cores: tuple[int, ...] = ()
    """Empty: every one."""
    timer_slack_s: float = 1e-6
    """0 s: as the system has it."""
    lock_memory: bool = False
    required: frozenset[Wish] = frozenset()


class RealTime(Table):
    """What programs that tick ask for in real time, each for all of them or by program.

    None of it changes a number; on another machine it may be other.
    """

    priority: Priority | dict[Ticking, Priority] = PRIORITY
    """Fixed priority (SCHED_FIFO), before all that has none; 0: none is asked for. By program,
    those that are not named ask for the default."""
    cores: Cores | dict[Ticking, Cores] = ()
    """Processors to run on, counted from 0; empty: any."""
    timer_slack_s: float = Field(default=1e-6, ge=0.0, le=1.0)
    """By how much the kernel may delay a wake-up of a program without a fixed priority, to join it
    with others; Linux itself takes 50 µs. 0: as the system has it."""
    lock_memory: bool = False
    """Keep what is in memory from being moved out of it."""
    computing_s: float = Field(default=0.002, gt=0.0, le=1.0)
    """What the programs and the bus take of a period, sample to command, the instruments apart:
    two samples on the bus and four steps, with room for the slow ones among them."""
    required: tuple[Wish, ...] = Field(default=(), strict=False)
    """What must be permitted, or the program does not start; the rest is done without."""

    def of(self, *programs: str) -> Wishes:
        """What a program asks for; where it composes several, the highest priority of theirs, and
        every processor that one of them may run on."""
        names = cast(tuple[Ticking, ...], programs)
        priority, cores = self.priority, self.cores
        each = [cores.get(name, ()) if isinstance(cores, dict) else cores for name in names]
        return Wishes(
            priority=max(priority.get(name, PRIORITY) for name in names)
            if isinstance(priority, dict)
            else priority,
            cores=tuple(sorted({core for some in each for core in some})) if all(each) else (),
            timer_slack_s=self.timer_slack_s,
            lock_memory=self.lock_memory,
            required=frozenset(self.required),
        )
