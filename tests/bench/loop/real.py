"""The real programs of the loop, in lockstep, with their simulated instruments."""

import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter

from pincette.bus.endpoints import program_endpoint
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Move
from pincette.core.faults import Mode
from pincette.core.messages import Reset
from pincette.core.topics import LOOP, RESET
from pincette.engine.arming import arm, status
from pincette.engine.fleet import Fleet
from pincette.sim.bench import open_bench
from pincette.sim.wires.wire import serve
from tests.bench.loop.contestant import Contestant
from tests.bench.loop.watch import Stopwatch, at_rest, obeyed, wait
from tests.support.rigs import demo_rig, rig_toml

GUARDS = Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.9, 1.0)


def bench_rig() -> RigFile:
    """The demo rig in lockstep on ports of its own, without the simulation's own log."""
    return demo_rig({"rig": {"name": "bench"}, "simulation": {"truth": False}}, time="lockstep")


def resting(ticks: int, period_s: float) -> Program:
    """Run a program that rests for a number of ticks; the control law is active throughout."""
    return Program((Move("rest", ticks * period_s, to_um=(0.0,)),), GUARDS, 2.17)


@contextmanager
def real_loop(
    name: str, folder: Path, rig: RigFile, *, plant: bool = False
) -> Generator[Contestant]:
    """Start router, services and instruments; the instruments are in this process.

    ``plant``: simulate a plant. Without one, the instruments do as little as those of a bare ring,
    so both cause the same delay.
    """
    simulated = open_bench(rig, perf_counter)
    sensor, output = simulated.sensor.answer, simulated.output.answer
    watch = Stopwatch(sensor if plant else at_rest(rig.sensor.noise_um, sensor))
    taker = Stopwatch(output if plant else obeyed(output))
    folder.mkdir(exist_ok=True)
    path = folder / "bench.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    fleet = Fleet(rig, path, folder, lambda _name, _line: None)
    after = simulated.rig.pass_time
    with (
        serve(rig.sensor.url, watch),
        serve(rig.output.url, taker, afterwards=after),
        _up(fleet, rig) as bus,
    ):
        epoch = 0

        def run(ticks: int) -> None:
            nonlocal epoch
            epoch += 1
            wish = resting(ticks, rig.rig.period_s)
            arm(bus, wish, epoch=epoch, digest=rig.digest())
            wait(lambda: len(watch.asked_s) >= ticks, name)
            wait(lambda: status(bus, "actuator").mode == Mode.IDLE, name)

        processes = {role: fleet.members[role].process.pid for role in LOOP}
        yield Contestant(name, run, watch, processes | {"instruments": os.getpid()})


@contextmanager
def _up(fleet: Fleet, rig: RigFile) -> Generator[ZenohBus]:
    """Start the programs, ready to be armed, and connect to their bus."""
    try:
        fleet.start(["router"])
        fleet.start(LOOP)
        bus = ZenohBus(program_endpoint(rig, "supervisor", lockstep=True), rig.rig.name, "bench")
        try:
            bus.call(RESET, Reset(acknowledge=True))
            yield bus
        finally:
            bus.close()
    finally:
        fleet.down()
