"""Dry run: the services of the loop play a plan against the arm of the model in use.

The engine is that of the rig, in one thread, in lockstep and on a bus in memory.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

from msgspec.structs import replace

from pincette.api.job_kinds import job_kinds
from pincette.api.results import JobResult
from pincette.bus.memory import MemoryBus
from pincette.bus.protocol import RefusalError
from pincette.config import RigFile, derived
from pincette.control.planning.program import Program, Segment
from pincette.core import plugins
from pincette.core.faults import TRIPPED, ActionCode
from pincette.core.messages import (
    Action,
    Applied,
    Command,
    Message,
    Position,
    Reset,
    Telemetry,
)
from pincette.core.messages.arms import ArmApplied, ArmPosition
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
from pincette.engine.instrument import Device, of_arms
from pincette.engine.loop import Loop
from pincette.engine.runner import Runner
from pincette.engine.timing_budget import stated_output
from pincette.instruments.protocols import Block
from pincette.records.columns import columns
from pincette_supervisor.planning.identified_arms import (
    IdentifiedArm,
    IdentifiedPair,
    Instruments,
    identified_arm,
    identified_pair,
)
from pincette_supervisor.planning.predicted_samples import Samples
from pincette_supervisor.plugin import Planned, Present, Run, functions_of

SWEEP = "a swept sine is played by the output alone"


@dataclass(slots=True)
class EmulatedInstruments:
    """Sensor and output of each arm; output voltages move the arms at the end of the tick."""

    rig: RigFile
    arms: IdentifiedArm | IdentifiedPair
    put_V: dict[int, float] = field(default_factory=dict[int, float])
    """Voltages that were output in this tick, by the index of the arm."""
    plays_wave: bool = False
    missed_um: float | None = None
    """Model error at the tick of the output, in µm, if a residual table contains it; always None
    with two arms."""

    @property
    def device(self) -> Device:
        """Return sensor and output of all arms as one device."""
        return of_arms([EmulatedDevice(self, arm) for arm in range(len(self.arms.targets_V))])

    def settle(self) -> None:
        """Move the arms by the output of this tick."""
        if not self.put_V:
            return
        voltages_V = [self.put_V.get(arm, at_V) for arm, at_V in enumerate(self.arms.targets_V)]
        if isinstance(self.arms, IdentifiedArm):
            self.arms = self.arms.moved(voltages_V[0], self.missed_um)
        else:
            self.arms = self.arms.moved((voltages_V[0], voltages_V[1]))
        self.put_V = {}

    def begun(self, applied: Applied) -> tuple[Applied, Position] | None:
        """Return two initial messages for the estimator if the arms are not at 0 V; otherwise
        None.
        """
        first_V, *others_V = self.arms.targets_V
        if not first_V and not any(others_V):
            return None
        outputs = (applied.arms[0], *(ArmApplied(one_V, 0) for one_V in others_V))
        tips = tuple(ArmPosition(x_um, valid=True) for x_um in self.arms.tips_um)
        return replace(applied, epoch=0, seq=-1, arms=outputs), Position(0, 0, 0.0, tips)


@dataclass(frozen=True, slots=True)
class EmulatedDevice:
    """Sensor and output of one arm."""

    instruments: EmulatedInstruments
    arm: int
    """Index of the arm."""

    def read_um(self) -> float:
        """Return the position that the sensor shows, in µm."""
        sensor = self.instruments.rig.arms[self.arm].sensor
        return sensor.offset_um + sensor.direction * self.instruments.arms.tips_um[self.arm]

    def begin_capture(self, rate_hz: float) -> None:
        """Acquire one sample per tick regardless of the rate: a sweep is not emulated."""

    def read_block(self) -> Block:
        """Return the sample of this tick."""
        return Block((self.read_um(),), (self.read_V(),))

    def end_capture(self) -> None:
        """Stop the acquisition."""

    def read_V(self) -> float:
        """Return the target voltage of the arm, in V."""
        return self.instruments.arms.targets_V[self.arm]

    def write_V(self, voltage_V: float) -> None:
        """Output a voltage."""
        self.instruments.put_V[self.arm] = voltage_V

    def write_parts(self, voltages_V: Sequence[float], interval_s: float) -> None:  # noqa: ARG002
        """Output a voltage step; the simulated arm computes its intermediate values."""
        self.write_V(voltages_V[-1])

    def begin_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:  # noqa: ARG002
        """Record that a wave is played, which is not emulated."""
        self.instruments.plays_wave = True

    def look(self) -> None:
        """Do nothing: the wave continues."""

    def close(self) -> None:
        """Do nothing: there is nothing to release."""


class RigEmulator:
    """The four services and the arm or arms; ``tick`` advances all of them by one sample."""

    def __init__(self, rig: RigFile, arm: IdentifiedArm | IdentifiedPair, program: Program) -> None:
        self.samples = Samples(len(rig.arms))
        self.heard: list[Message] = []
        """All messages of the services; recorded only for two arms."""
        self.ended = False
        self.told: Telemetry | None = None
        self._rig, self._program = rig, program
        self._residual = derived.residual(rig.model)
        self._instruments = EmulatedInstruments(rig, arm)
        self._bus = MemoryBus()
        # The timing is not checked, so that a plan for which the rig's instruments are too slow is
        # emulated too.
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
        heard = (POSITION, ESTIMATE) if self.samples.arms == 2 else ()
        for topic in (COMMAND, TELEMETRY, APPLIED, *heard):
            self._bus.subscribe(topic, self._hear)
        self._begin()

    def _hear(self, _topic: Topic, message: Message) -> None:
        if self.samples.arms == 2:
            self.heard.append(message)
        if isinstance(message, Command):
            self._command = message
        elif isinstance(message, Telemetry):
            self.told = message
        elif isinstance(message, Applied):
            self._applied = message

    def hang(self, weight_mN: float, arm: int) -> None:
        """Hang a weight at the tip of arm 1 or 2."""
        self._instruments.arms = self._instruments.arms.hang(weight_mN, arm)

    @property
    def outcome(self) -> str:
        """Return the outcome of the program; empty as long as it has none."""
        if self._applied is not None and self._applied.state in TRIPPED:
            return "tripped"
        return "" if self.told is None else self.told.outcome

    @property
    def segment(self) -> Segment | None:
        """Return the segment of the program that is being played."""
        return self._program.segments[self.place] if self.place >= 0 else None

    @property
    def place(self) -> int:
        """Return the number of the segment that is being played; -1 if no segment is being
        played.
        """
        number = -1 if self.told is None else self.told.segment
        return number if number < len(self._program.segments) else -1

    def _begin(self) -> None:
        """Start all services at the position of the arm."""
        self._bus.call(RESET, Reset(acknowledge=True))
        rest = self._bus.latest(APPLIED)
        begun = None if rest is None else self._instruments.begun(cast(Applied, rest))
        if begun is not None:
            # As on a rig that was in use, the estimator has followed the arm to its present
            # position.
            estimator = self._loop.runner("estimator")
            for message in begun:
                estimator.take(message, 0.0)
            estimator.fire(0.0)
        arm_loop(self._bus, self._program, epoch=1, digest=self._rig.digest())

    def tick(self, seq: int) -> str:
        """Advance by one sample; return why nothing can be predicted beyond it."""
        while (self._applied is None or self._applied.seq < seq) and self._bus.pump():
            pass
        applied, command = self._applied, self._command
        if applied is None or command is None:
            return "the simulated services have not replied"
        if self.told is not None:
            arms, at_s = self._instruments.arms, seq * self._rig.rig.period_s
            self.samples.add(at_s, arms.tips_um, arms.forces_mN, (command, applied, self.told))
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
        """Request an action of the controller; return the reason if it is refused, otherwise an
        empty text.
        """
        try:
            self._bus.call(ACTION, Action(ActionCode(action)))
        except RefusalError as error:
            return str(error)
        return ""


LONGEST_S, LONGEST_SAMPLES = 120.0, 30_000
"""Longest time in s, and largest number of samples, of a plan that are played; the shorter one
applies.
"""
ENDLESS_S = 0.3
"""Duration in s for which a segment without an end is played; the plan shows it with this
duration.
"""


@dataclass(frozen=True, slots=True)
class DryRun:
    """Result of a dry run: the samples, the outcome, and the reason why the remainder was not
    played.
    """

    samples: Samples
    outcome: str
    cut: str
    instruments: Instruments
    figures: JobResult | None = None
    """Two arms only: result of the samples, evaluated like those of a job."""


def stated_instruments(rig: RigFile) -> Instruments:
    """Return delay and lag as stated by the drivers of a rig; 0 if they state none."""
    return Instruments(*stated_output(rig))


def run_dry(planned: Planned, present: Present, *, part: bool) -> DryRun:
    """Play a plan from the present state of the arm.

    A wait for a person ends after ``ENDLESS_S``, with the requested weight hung; a hold without an
    end is released after that time.

    Parameters
    ----------
    part
        True if the part is present, as described by the rig file or a recipe.
    """
    rig = planned.armed.rig
    rig = rig.model_copy(update={"rig": rig.rig.model_copy(update={"time": "lockstep"})})
    instruments, period_s = stated_instruments(rig), rig.rig.period_s
    arm: IdentifiedArm | IdentifiedPair
    if rig.second is not None:
        held = planned.begins_held
        arm = identified_pair(rig, instruments, present, part=part, held=held)
    else:
        arm = identified_arm(rig, instruments, present.stand_V(rig), rig.part if part else None)
        if present.x_um is not None and not planned.begins_held:
            arm = arm.at(present.x_um)
    emulator = RigEmulator(rig, arm, planned.program)
    cut, released = _played(emulator, planned, period_s)
    # The controller reports no outcome if a person ended the hold.
    otherwise = "released" if released and not cut else "unfinished"
    outcome = emulator.outcome or otherwise
    return DryRun(emulator.samples, outcome, cut, instruments, _figures(planned, rig, emulator))


def _figures(planned: Planned, rig: RigFile, emulator: RigEmulator) -> JobResult | None:
    """Return the result of the predicted samples if the kind shows it; None without samples."""
    kind = job_kinds()[planned.plan.kind]
    shown = kind.figures_in_prediction and rig.second is not None
    if not shown or not emulator.heard or not emulator.samples.t_s:
        return None
    table = columns(emulator.heard, rig.rig.period_s)
    return functions_of(kind).evaluate(Run(rig, planned, table, emulator.heard)).result


def _played(emulator: RigEmulator, planned: Planned, period_s: float) -> tuple[str, bool]:
    """Play to the end; return why no more was played, and whether a part was released."""
    longest = min(int(LONGEST_S / period_s + 0.5), LONGEST_SAMPLES)
    prompted, released = -1, False
    for seq in range(longest):
        cut = emulator.tick(seq)
        if cut or emulator.ended:
            return cut, released
        segment, told, place = emulator.segment, emulator.told, emulator.place
        if segment is None or told is None:
            continue
        wait = planned.waits.get(place)
        if wait is not None and wait.weight_mN is not None and told.segment_tick <= 1:
            emulator.hang(wait.weight_mN, planned.values.get("arm", 1))
        waited = segment.duration_s is None and told.segment_tick * period_s >= ENDLESS_S
        if waited and place != prompted:
            prompted, released = place, wait is None
            cut = emulator.act("release" if released else "continue")
            if cut:
                return cut, False
    return f"{longest * period_s:g} s can be predicted at most", released
