"""The services of the loop and the arm as the model has it, sample by sample in one thread.

The same engine as on the rig, in lockstep and on a bus in memory, so that what is predicted is what
these services would do.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

from msgspec.structs import replace

from pincette.bus.memory import MemoryBus
from pincette.bus.protocol import RefusalError
from pincette.config import RigFile, derived
from pincette.control.planning.program import Program, Segment
from pincette.core import plugins
from pincette.core.faults import TRIPPED, ActionCode
from pincette.core.messages import Action, Applied, Command, Message, Position, Reset, Telemetry
from pincette.core.topics import ACTION, APPLIED, COMMAND, LOOP, RESET, TELEMETRY, Topic
from pincette.core.wording import applied_text
from pincette.engine.arming import arm as arm_loop
from pincette.engine.loop import Loop
from pincette.engine.node import Node
from pincette.instruments.protocols import Block
from pincette_supervisor.planning.identified_arm import IdentifiedArm

SWEEP = "a swept sine is played by the output alone"


@dataclass(slots=True)
class Samples:
    """What is predicted, sample by sample; lists of one length."""

    t_s: list[float] = field(default_factory=list[float])
    phase: list[str] = field(default_factory=list[str])
    x_um: list[float] = field(default_factory=list[float])
    force_mN: list[float] = field(default_factory=list[float])
    """Of the contact, compressive and positive."""
    asked_V: list[float] = field(default_factory=list[float])
    """By the controller; the actuator's limits may keep the voltage from it."""
    voltage_V: list[float] = field(default_factory=list[float])
    """As it is applied."""
    x_r_um: list[float] = field(default_factory=list[float])
    force_r_mN: list[float] = field(default_factory=list[float])
    sliding_um: list[float] = field(default_factory=list[float])
    band_um: list[float] = field(default_factory=list[float])

    def add(
        self, t_s: float, arm: IdentifiedArm, voltages_V: tuple[float, float], told: Telemetry
    ) -> None:
        """Add a sample: voltage asked for and applied, and what the controller has told of it."""
        self.t_s.append(t_s)
        self.phase.append(told.phase)
        self.x_um.append(arm.x_um)
        self.force_mN.append(arm.force_mN)
        self.asked_V.append(voltages_V[0])
        self.voltage_V.append(voltages_V[1])
        self.x_r_um.append(told.x_r_um)
        self.force_r_mN.append(told.force_r_mN)
        self.sliding_um.append(told.sliding_um)
        self.band_um.append(told.band_um)


@dataclass(slots=True)
class ArmInstruments:
    """Sensor and output of an emulated arm; what is put out moves it once the tick is over."""

    rig: RigFile
    arm: IdentifiedArm
    put_V: float | None = None
    """Put out in this tick."""
    plays_wave: bool = False
    missed_um: float | None = None
    """What the model misses at the tick that is put out, where a residual table knows it."""

    def read_um(self) -> float:
        """What the sensor shows of where the arm stands, in µm."""
        sensor = self.rig.sensor
        return sensor.offset_um + sensor.direction * self.arm.x_um

    def begin_capture(self, rate_hz: float) -> None:
        """Acquire one sample a tick, whatever the rate: a sweep is not emulated."""

    def read_block(self) -> Block:
        """The sample of this tick."""
        return Block((self.read_um(),), (self.arm.target_V,))

    def end_capture(self) -> None:
        """Acquire no more."""

    def read_V(self) -> float:
        """The voltage that the arm goes to."""
        return self.arm.target_V

    def write_V(self, voltage_V: float) -> None:
        """Put out a voltage."""
        self.put_V = voltage_V

    def begin_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:  # noqa: ARG002
        """Note that a wave is played, which is not emulated."""
        self.plays_wave = True

    def look(self) -> None:
        """The wave goes on."""

    def settle(self) -> None:
        """Let the arm follow what was put out in this tick."""
        if self.put_V is not None:
            self.arm, self.put_V = self.arm.moved(self.put_V, self.missed_um), None

    def close(self) -> None:
        """Have nothing to give back."""


class RigEmulator:
    """The four services and the arm; ``tick`` takes all of them on by one sample."""

    def __init__(self, rig: RigFile, arm: IdentifiedArm, program: Program) -> None:
        self.samples = Samples()
        self.ended = False
        self.told: Telemetry | None = None
        self._rig, self._program = rig, program
        self._residual = derived.residual(rig.model)
        self._instruments = ArmInstruments(rig, arm)
        self._bus = MemoryBus()
        # A plan is emulated too where the rig's instruments are too slow for it to be armed.
        nodes = [
            Node(service, rig, service.instrument and self._instruments, check_timing=False)
            for service in (plugins.load(plugins.SERVICES, name) for name in LOOP)
        ]
        self._loop = Loop(nodes, self._bus, inline=True)
        self._bus.step_when_empty(self._loop.step)
        self._command: Command | None = None
        self._applied: Applied | None = None
        for topic in (COMMAND, TELEMETRY, APPLIED):
            self._bus.subscribe(topic, self._hear)
        self._begin()

    def _hear(self, _topic: Topic, message: Message) -> None:
        if isinstance(message, Command):
            self._command = message
        elif isinstance(message, Telemetry):
            self.told = message
        elif isinstance(message, Applied):
            self._applied = message

    @property
    def arm(self) -> IdentifiedArm:
        """The arm as it stands."""
        return self._instruments.arm

    @arm.setter
    def arm(self, arm: IdentifiedArm) -> None:
        self._instruments.arm = arm

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
        if self.arm.target_V and rest is not None:
            # The estimator has followed the arm to where it stands, as on a rig that was in use.
            estimator = self._loop.scheduler.task("estimator").node
            estimator.accept(replace(cast(Applied, rest), epoch=0, seq=-1), 0.0)
            estimator.accept(Position(0, 0, 0.0, self.arm.x_um, valid=True), 0.0)
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
            voltages_V = command.voltage_V, applied.voltage_V
            self.samples.add(seq * self._rig.rig.period_s, self.arm, voltages_V, self.told)
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
