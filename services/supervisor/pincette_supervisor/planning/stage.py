"""The services of the loop and the arm as the model has it, sample by sample in one thread.

The same steps as on the rig, without bus and instruments, so that what is foretold is what these
services would do.
"""

from dataclasses import dataclass, field, replace
from typing import Any, cast

from pincette import plugins
from pincette.config import RigFile
from pincette.control.planning.program import Program, Segment
from pincette.messages import (
    Act,
    Applied,
    Arm,
    Command,
    Estimate,
    Load,
    Message,
    Position,
    Reset,
    Telemetry,
)
from pincette.service import AnyService, Drive, Reading, RefusedError, Wave
from pincette.topics import LOOP
from pincette_supervisor.planning.identified_arm import IdentifiedArm

SWEEP = "a swept sine is played by the output alone"
TRIPPED = ("frozen", "ramping", "latched")


@dataclass(slots=True)
class Samples:
    """What is foretold, sample by sample; lists of one length."""

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


class Stage:
    """The four services and the arm; ``tick`` takes all of them on by one sample."""

    def __init__(self, rig: RigFile, arm: IdentifiedArm, program: Program) -> None:
        self.arm, self.samples = arm, Samples()
        self.ended = False
        self.told: Telemetry | None = None
        self._rig, self._program = rig, program
        self._services: dict[str, AnyService] = {
            name: plugins.load(plugins.SERVICES, name) for name in LOOP
        }
        self._configs: dict[str, Any] = {
            name: service.configure(rig) for name, service in self._services.items()
        }
        self._states: dict[str, Any] = {
            name: service.start(self._configs[name]) for name, service in self._services.items()
        }
        self._applied = self._begin()

    @property
    def outcome(self) -> str:
        """How the program ends, as far as it is known."""
        if self._applied.state in TRIPPED:
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

    def _begin(self) -> Applied:
        """Let all services begin where the arm stands; returns the voltage applied before."""
        adopt = self._services["actuator"].adopt
        if adopt is not None:
            config, state = self._configs["actuator"], self._states["actuator"]
            self._states["actuator"] = adopt(config, state, self.arm.target_V)
        (rest,) = self._ask("actuator", Reset(acknowledge=True))
        if self.arm.target_V:
            # The estimator has followed the arm to where it stands, as on a rig that was in use.
            stood = Position(0, 0, 0.0, self.arm.x_um, valid=True)
            self._step("estimator", stood, replace(cast(Applied, rest), epoch=0, seq=-1))
        self._ask("controller", Load(self._program))
        order = Arm(1, 1, self._rig.digest(), capture_hz=self._program.capture_hz)
        (applied,) = self._ask("actuator", order)
        for name in ("estimator", "controller", "sensor"):
            self._ask(name, order)
        return cast(Applied, applied)

    def _ask(self, name: str, request: Message) -> tuple[Any, ...]:
        service = self._services[name]
        state, _, outputs = service.answer(self._configs[name], self._states[name], request, 0.0)
        self._states[name] = state
        return outputs

    def _step(self, name: str, *inputs: Any, now: float = 0.0) -> tuple[Any, ...]:
        service = self._services[name]
        state, outputs = service.step(
            self._configs[name], self._states[name], service.inputs_type(*inputs), now
        )
        self._states[name] = state
        return outputs

    def tick(self, seq: int) -> str:
        """One sample; returns why nothing can be foretold beyond it."""
        now, sensor = seq * self._rig.rig.period_s, self._rig.sensor
        reading = Reading(sensor.offset_um + sensor.direction * self.arm.x_um)
        position, *_ = self._step("sensor", reading, now=now)
        (estimate,) = self._step("estimator", position, self._applied, now=now)
        answer, *told = self._step("controller", cast(Estimate, estimate), now=now)
        command = cast(Command, answer)
        self._step("actuator", None, None, position, now=now)
        order, applied = self._step("actuator", None, command, None, now=now)
        self._applied = cast(Applied, applied)
        self.told = cast(Telemetry, told[0]) if told else self.told
        if self.told is not None:
            voltages_V = command.voltage_V, self._applied.voltage_V
            self.samples.add(now, self.arm, voltages_V, self.told)
        if isinstance(order, Wave):
            return SWEEP
        if isinstance(order, Drive):
            self.arm = self.arm.moved(order.voltage_V)
        self.ended = self._applied.final
        if self._applied.state in TRIPPED:
            return f"the actuator trips: {self._applied.cause}"
        return ""

    def act(self, action: str) -> str:
        """Ask the controller for an action; returns why it refuses."""
        try:
            self._ask("controller", Act(action))
        except RefusedError as error:
            return str(error)
        return ""
