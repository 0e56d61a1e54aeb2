"""Rigs on one router, with their simulated instruments in a few processes."""

from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from secrets import randbits
from typing import cast

from pincette.bus.endpoints import program_endpoint
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.core.messages import Reset, Timing, TimingRequest
from pincette.core.topics import RESET, TIMING_OF
from pincette.engine.arming import arm
from pincette.engine.fleet import Fleet
from tests.bench.loop.real import resting
from tests.bench.realtime.drivers import OUTPUT, SENSOR, registered
from tests.bench.realtime.instruments import instruments
from tests.support.rigs import Tree, demo_rig, laid_over, rig_toml

EPOCH_BITS = 47
TOGETHER = 4
"""Number of rigs whose instruments share a process, and therefore one interpreter lock."""
TOLD = ("sensor", "actuator")
"""Services whose timing is measured: the first and the last of a tick."""


@dataclass(frozen=True, slots=True)
class Rig:
    """A running rig."""

    file: RigFile
    bus: ZenohBus
    processes: dict[str, int]
    """Process numbers by program; the first of every ``TOGETHER`` rigs also has the process of
    their instruments."""

    def begin(self, duration_s: float) -> None:
        """Keep the arm in place under closed-loop control for a given time."""
        period_s = self.file.rig.period_s
        self.bus.call(RESET, Reset(acknowledge=True))
        program = resting(round(duration_s / period_s), period_s)
        arm(self.bus, program, epoch=randbits(EPOCH_BITS), digest=self.file.digest())

    def timing(self) -> dict[str, Timing]:
        """Return the timing of the services since ``begin``."""
        settings = TimingRequest()
        return {name: cast(Timing, self.bus.call(TIMING_OF[name], settings)) for name in TOLD}


@contextmanager
def rigs_up(count: int, folder: Path, own: Tree) -> Generator[list[Rig]]:
    """Start rigs on their own ports; the first has the router.

    ``own`` holds the settings of all rigs that differ from the demo rig.
    """
    files: list[RigFile] = []
    for number in range(count):
        joins = {"router": f"127.0.0.1:{files[0].bus.port}"} if files else {}
        each: Tree = {
            "rig": {"name": f"rig{number}"},
            "bus": joins,
            "simulation": {"truth": False, "seed": number},
        }
        files.append(demo_rig(laid_over(own, each)))
    with ExitStack() as stack:
        stack.enter_context(registered(folder))
        simulated = [_written(rig, folder, "instruments") for rig in files]
        firsts = range(0, count, TOGETHER)
        serving = [
            stack.enter_context(instruments(simulated[first : first + TOGETHER]))
            for first in firsts
        ]
        found = [stack.enter_context(_rig_up(rig, folder)) for rig in files]
        for first, process in zip(firsts, serving, strict=True):
            found[first].processes["instruments"] = process
        yield found


@contextmanager
def _rig_up(rig: RigFile, folder: Path) -> Generator[Rig]:
    rig = rig.model_copy(
        update={
            "sensor": rig.sensor.model_copy(update={"driver": SENSOR}),
            "output": rig.output.model_copy(update={"driver": OUTPUT}),
        }
    )
    fleet = Fleet(rig, _written(rig, folder, "loop"), folder, lambda _name, _line: None)
    try:
        fleet.start([] if rig.joins else ["router"])
        fleet.start(rig.programs)
        bus = ZenohBus(program_endpoint(rig, "supervisor", lockstep=False), rig.rig.name, "bench")
        try:
            processes = {name: one.process.pid for name, one in fleet.members.items()}
            yield Rig(rig, bus, processes)
        finally:
            bus.close()
    finally:
        fleet.down()


def _written(rig: RigFile, folder: Path, name: str) -> Path:
    path = folder / f"{rig.rig.name}-{name}.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    return path


def numbers(rigs: Sequence[Rig]) -> dict[str, list[int]]:
    """Processes by program."""
    found: dict[str, list[int]] = {}
    for rig in rigs:
        for name, process in rig.processes.items():
            found.setdefault(name, []).append(process)
    return found
