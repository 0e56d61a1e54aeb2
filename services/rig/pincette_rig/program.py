"""Rig program: the simulated plant behind the byte protocols of its instruments."""

import logging
import secrets
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager

from pincette import __version__
from pincette.bus.refused import RefusedMessages
from pincette.config import ConfigError
from pincette.core.messages import Status
from pincette.core.topics import STATUS
from pincette.engine.program import Context
from pincette.engine.realtime.os_scheduling import raise_priority
from pincette.engine.simulated import serve_sim_commands
from pincette.sim.bench import open_bench
from pincette.sim.script.script import script_of
from pincette_rig.arm_file import ArmFile

log = logging.getLogger(__name__)
BEHIND_S = 0.1
"""Longest delay in s that a rig makes up for; after a longer one it skips the time."""


class Pace:
    """Limits the speed of lockstep to ``pace`` times real time."""

    def __init__(
        self,
        pace: float,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[float], object] = time.sleep,
    ) -> None:
        self._pace, self._clock, self._wait = pace, clock, wait
        self._began_s = clock()

    def __call__(self, rig_s: float) -> None:
        """Wait until the clock has reached the time of the rig."""
        early_s = self._began_s + rig_s / self._pace - self._clock()
        if early_s > 0.0:
            self._wait(early_s)
        elif early_s < -BEHIND_S:
            self._began_s -= early_s


@contextmanager
def kept_arm(file: ArmFile) -> Generator[None]:
    """Keep the simulated arm over restarts of this program, if its folder permits it."""
    try:
        file.start()
    except OSError as error:
        log.warning("the simulated arm is new at each start: %s", error)
        yield
        return
    try:
        yield
    finally:
        file.close()


def run(context: Context) -> None:
    """Serve all instruments at their urls, and simulation commands, until stopped."""
    rig, simulation = context.rig, context.rig.simulation
    if simulation is None:
        raise ConfigError(
            f"rig {rig.rig.name!r} has no [simulation]: its instruments are real, and there "
            "is nothing for `pincette run rig` to do"
        )
    if not rig.lockstep:
        raise_priority(rig.realtime.of("rig"))
    bus = context.open_bus()

    try:
        script = script_of(rig)
        pace = Pace(simulation.pace) if rig.lockstep and simulation.pace else None
        # Runs in the output's thread, before the reply to the write.
        truth = bus.publish if simulation.truth else None
        bench = open_bench(rig, time.monotonic, truth, script, pace)
        with bench.offer(), kept_arm(ArmFile(rig, context.data, bench.rig)):
            serve_sim_commands(bus, script)
            instance, digest = secrets.randbits(48), rig.digest()
            bus.serve(
                STATUS["rig"],
                lambda _, _request, reply: reply(status(instance, digest, bus.refused)),
            )
            bus.announce("rig")
            urls = dict.fromkeys(fitted.url for fitted in bench.fitted.values())
            context.ready(f"simulates {' and '.join(urls)}")
            context.stop.wait()
    finally:
        bus.close()


def status(instance: int, digest: str, refused: RefusedMessages) -> Status:
    """Return the status of this program, which has no epoch and no steps."""
    found = refused.finding()
    return Status(
        service="rig",
        version=__version__,
        instance=instance,
        digest=digest,
        epoch=0,
        steps=0,
        missed=0,
        refused=refused.count,
        findings=() if found is None else (found,),
    )
