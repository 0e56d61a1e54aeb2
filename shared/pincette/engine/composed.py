"""The whole loop in one process: the same services and instruments, in lockstep, over a bus in
memory.

Only the transport differs from the loop of five processes, so the results are bit-identical.
"""

from collections.abc import Callable

from pincette.bus.memory import MemoryBus
from pincette.config import ConfigError, RigFile
from pincette.control.planning.program import Program
from pincette.core import plugins
from pincette.core.messages import GroundTruth, Message, Reset
from pincette.core.topics import LOOP, RESET, TOPICS, Topic
from pincette.engine.arming import arm
from pincette.engine.loop import Loop
from pincette.engine.runner import Runner
from pincette.engine.simulated import devices_on, simulated_devices
from pincette.sim.bench import Bench

Benches = Callable[[Callable[[GroundTruth], None]], Bench]
"""Function that sets up the simulated rig. Its argument is called with the true state of the rig in
each tick."""


class ComposedLoop:
    """A simulated rig and its four services, ready to be armed; ``bus.pump`` makes its steps.

    ``bench`` sets up the simulated rig; callers use it to act on the rig between programs.
    """

    def __init__(self, rig: RigFile, bench: Benches | None = None) -> None:
        if not rig.lockstep or rig.simulation is None:
            raise ConfigError('one process needs [rig] time = "lockstep" and a [simulation]')
        self.rig = rig
        self.bus = MemoryBus()
        if bench is None:
            devices = simulated_devices(rig, self.bus.publish)
        else:
            devices = devices_on(bench(self.bus.publish), rig)
        runners = [
            Runner(plugins.load(plugins.SERVICES, name), rig, devices.get(name)) for name in LOOP
        ]
        self.bus.step_when_empty(Loop(runners, self.bus, inline=True).step)
        self._published: list[Message] | None = None

    def play(self, program: Program, epoch: int = 1, calibration: str = "") -> list[Message]:
        """Arm, play a program to its end, and return all messages in order.

        ``calibration`` is the text of the calibrated values of the arming.
        """
        if self._published is None:
            for topic in TOPICS:
                self.bus.subscribe(topic, self._keep)
        published: list[Message] = []
        self._published = published
        self.bus.call(RESET, Reset(acknowledge=True))
        digest = self.rig.digest()
        arm(self.bus, program, epoch=epoch, digest=digest, calibration=calibration)
        while self.bus.pump():
            pass
        return published

    def _keep(self, _topic: Topic, message: Message) -> None:
        if self._published is not None:
            self._published.append(message)
