"""The services of the loop and the arm as the model has it, sample by sample in one thread.

The same engine as on the rig, in lockstep and on a bus in memory, so that what is predicted is what
these services would do.
"""

from typing import cast

from pincette.bus.memory import MemoryBus
from pincette.bus.protocol import RefusalError
from pincette.config import RigFile, derived
from pincette.control.planning.program import Program, Segment
from pincette.core import plugins
from pincette.core.faults import TRIPPED, ActionCode
from pincette.core.messages import Action, Applied, Command, Message, Reset, Telemetry
from pincette.core.topics import (
    ACTION,
    APPLIED,
    COMMAND,
    ESTIMATE,
    LOOP,
    POSITION,
    RESET,
    TELEMETRY,
    Topic,
)
from pincette.core.wording import applied_text
from pincette.engine.arming import arm as arm_loop
from pincette.engine.loop import Loop
from pincette.engine.runner import Runner
from pincette_supervisor.planning.emulated_instruments import ArmInstruments, PairInstruments
from pincette_supervisor.planning.identified_arm import IdentifiedArm
from pincette_supervisor.planning.identified_pair import IdentifiedPair
from pincette_supervisor.planning.predicted_samples import Samples, SecondSamples

SWEEP = "a swept sine is played by the output alone"


class RigEmulator:
    """The four services and the arm, or both; ``tick`` takes all on by one sample."""

    def __init__(self, rig: RigFile, arm: IdentifiedArm | IdentifiedPair, program: Program) -> None:
        self.samples = Samples()
        self.heard: list[Message] = []
        """All that was said, of two arms."""
        self.ended = False
        self.told: Telemetry | None = None
        self._rig, self._program = rig, program
        self._residual = derived.residual(rig.model)
        self._instruments: ArmInstruments | PairInstruments
        if isinstance(arm, IdentifiedPair):
            self._instruments = PairInstruments(rig, arm)
            self.samples.second = SecondSamples()
        else:
            self._instruments = ArmInstruments(rig, arm)
        self._bus = MemoryBus()
        # A plan is emulated too where the rig's instruments are too slow for it to be armed.
        runners = [
            Runner(
                service,
                rig,
                self._instruments.device if service.instrument else None,
                check_timing=False,
            )
            for service in (plugins.load(plugins.SERVICES, name) for name in LOOP)
        ]
        self._loop = Loop(runners, self._bus, inline=True)
        self._bus.step_when_empty(self._loop.step)
        self._command: Command | None = None
        self._applied: Applied | None = None
        heard = (POSITION, ESTIMATE) if self.samples.second is not None else ()
        for topic in (COMMAND, TELEMETRY, APPLIED, *heard):
            self._bus.subscribe(topic, self._hear)
        self._begin()

    def _hear(self, _topic: Topic, message: Message) -> None:
        if self.samples.second is not None:
            self.heard.append(message)
        if isinstance(message, Command):
            self._command = message
        elif isinstance(message, Telemetry):
            self.told = message
        elif isinstance(message, Applied):
            self._applied = message

    def hang(self, weight_mN: float, arm: int) -> None:
        """Hang a weight at the tip of arm 1 or 2."""
        self._instruments.hang(weight_mN, arm)

    @property
    def outcome(self) -> str:
        """How the program ends, as far as it is known."""
        if self._applied is not None and self._applied.state in TRIPPED:
            return "tripped"
        return "" if self.told is None else self.told.outcome

    @property
    def segment(self) -> Segment | None:
        """The segment of the program that plays."""
        return self._program.segments[self.place] if self.place >= 0 else None

    @property
    def place(self) -> int:
        """Number of that segment; -1 where none of the program plays."""
        number = -1 if self.told is None else self.told.segment
        return number if number < len(self._program.segments) else -1

    def _begin(self) -> None:
        """Let all services begin where the arm stands."""
        self._bus.call(RESET, Reset(acknowledge=True))
        rest = self._bus.latest(APPLIED)
        begun = None if rest is None else self._instruments.begun(cast(Applied, rest))
        if begun is not None:
            # The estimator has followed the arm to where it stands, as on a rig that was in use.
            estimator = self._loop.runner("estimator")
            for message in begun:
                estimator.take(message, 0.0)
            estimator.fire(0.0)
        arm_loop(self._bus, self._program, epoch=1, digest=self._rig.digest())

    def tick(self, seq: int) -> str:
        """One sample; returns why nothing can be predicted beyond it."""
        while (self._applied is None or self._applied.seq < seq) and self._bus.pump():
            pass
        applied, command = self._applied, self._command
        if applied is None or command is None:
            return "the services have not answered"
        if self.told is not None:
            at_s = seq * self._rig.rig.period_s
            self._instruments.add_to(self.samples, at_s, (command, applied, self.told))
        if self._instruments.plays_wave:
            return SWEEP
        if self._residual is not None and command.segment is not None:
            known = self._residual.at(command.segment, command.segment_tick)
            self._instruments.missed_um = None if known is None else known.value_um
        self._instruments.settle()
        self.ended = applied.final
        if applied.state in TRIPPED:
            return f"the actuator trips: {applied_text(applied)}"
        return ""

    def act(self, action: str) -> str:
        """Ask the controller for an action; returns why it refuses."""
        try:
            self._bus.call(ACTION, Action(ActionCode(action)))
        except RefusalError as error:
            return str(error)
        return ""
