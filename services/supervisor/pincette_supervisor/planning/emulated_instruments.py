"""Sensor and output of the arms as the model has them; what is put out moves them later."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from msgspec.structs import replace

from pincette.config import RigFile
from pincette.core.messages import Applied, Command, Position, Telemetry
from pincette.core.messages.arms import ArmApplied, ArmPosition
from pincette.engine.instrument import Device
from pincette.instruments.protocols import Block
from pincette_supervisor.planning.identified_arm import IdentifiedArm
from pincette_supervisor.planning.identified_pair import IdentifiedPair
from pincette_supervisor.planning.predicted_samples import Samples

Answers = tuple[Command, Applied, Telemetry]
"""To one sample."""


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

    def write_parts(self, voltages_V: Sequence[float], interval_s: float) -> None:  # noqa: ARG002
        """Put out a step, whose parts the arm knows."""
        self.put_V = voltages_V[-1]

    def begin_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:  # noqa: ARG002
        """Note that a wave is played, which is not emulated."""
        self.plays_wave = True

    def look(self) -> None:
        """The wave goes on."""

    def settle(self) -> None:
        """Let the arm follow what was put out in this tick."""
        if self.put_V is not None:
            self.arm, self.put_V = self.arm.moved(self.put_V, self.missed_um), None

    @property
    def device(self) -> Device:
        """Sensor and output at once."""
        return self

    def hang(self, weight_mN: float, arm: int) -> None:  # noqa: ARG002
        """Hang a weight at the tip."""
        self.arm = self.arm.hang(weight_mN)

    def begun(self, applied: Applied) -> tuple[Applied, Position] | None:
        """What the estimator is to have heard of arms that stand away from 0 V."""
        if not self.arm.target_V:
            return None
        position = Position(0, 0, 0.0, (ArmPosition(self.arm.x_um, valid=True),))
        return replace(applied, epoch=0, seq=-1), position

    def add_to(self, samples: Samples, t_s: float, told: Answers) -> None:
        """Add a sample of what is now."""
        command, applied, view = told
        voltages_V = command.arms[0].voltage_V, applied.arms[0].voltage_V
        samples.add(t_s, self.arm.x_um, self.arm.force_mN, voltages_V, view)

    def close(self) -> None:
        """Have nothing to give back."""


@dataclass(slots=True)
class PairInstruments:
    """Sensors and outputs of two emulated arms, which move together once the tick is over."""

    rig: RigFile
    pair: IdentifiedPair
    put_V: list[float | None] = field(default_factory=lambda: [None, None])
    """Put out in this tick, by arm."""
    plays_wave: bool = False
    missed_um: float | None = None
    """There are no residual tables of two arms."""

    @property
    def device(self) -> Device:
        """Each arm's sensor and output at once."""
        return (OneOfPair(self, 0), OneOfPair(self, 1))

    def settle(self) -> None:
        """Let both arms follow what was put out in this tick."""
        first_V, second_V = self.put_V
        if first_V is None and second_V is None:
            return
        at_V = self.pair.targets_V
        first_V = at_V[0] if first_V is None else first_V
        second_V = at_V[1] if second_V is None else second_V
        self.pair, self.put_V = self.pair.moved((first_V, second_V)), [None, None]

    def hang(self, weight_mN: float, arm: int) -> None:
        """Hang a weight at the tip of arm 1 or 2."""
        self.pair = self.pair.hang(arm - 1, weight_mN)

    def begun(self, applied: Applied) -> tuple[Applied, Position] | None:
        """What the estimator is to have heard of arms that stand away from 0 V."""
        if not any(self.pair.targets_V):
            return None
        (x_1, x_2), u_2 = self.pair.tips_um, self.pair.targets_V[1]
        arms = ArmPosition(x_1, valid=True), ArmPosition(x_2, valid=True)
        outputs = applied.arms[0], ArmApplied(u_2, 0)
        return replace(applied, epoch=0, seq=-1, arms=outputs), Position(0, 0, 0.0, arms)

    def add_to(self, samples: Samples, t_s: float, told: Answers) -> None:
        """Add a sample of what is now."""
        command, applied, view = told
        tips_um, (force_1, force_2) = self.pair.tips_um, self.pair.forces_mN
        asked, put_out = command.arms, applied.arms
        samples.add(t_s, tips_um[0], force_1, (asked[0].voltage_V, put_out[0].voltage_V), view)
        if (
            samples.second is None
            or len(asked) == 1
            or len(put_out) == 1
            or view.place_r_um is None
        ):
            raise ValueError("the services have answered for one arm")
        voltages_V = asked[1].voltage_V, put_out[1].voltage_V
        samples.second.add(tips_um, force_2, voltages_V, view.place_r_um)


@dataclass(frozen=True, slots=True)
class OneOfPair:
    """Sensor and output of arm 0 or 1."""

    both: PairInstruments
    arm: int

    def read_um(self) -> float:
        """What the sensor shows of where the arm stands, in µm."""
        sensor = self.both.rig.arms[self.arm].sensor
        return sensor.offset_um + sensor.direction * self.both.pair.tips_um[self.arm]

    def read_V(self) -> float:
        """The voltage that the arm goes to."""
        return self.both.pair.targets_V[self.arm]

    def write_V(self, voltage_V: float) -> None:
        """Put out a voltage."""
        self.both.put_V[self.arm] = voltage_V

    def close(self) -> None:
        """Have nothing to give back."""
