"""Simulated rig of two arms, each measured and driven separately, in lockstep or real time."""

import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from msgspec import structs
from msgspec.structs import replace

from pincette.config import Simulation
from pincette.core.messages import GroundTruth
from pincette.core.messages.arms import ArmTruth
from pincette.sim.plant.drive import quantised_V
from pincette.sim.plant.noise import GaussianNoise
from pincette.sim.plant.pair_modes import Pair
from pincette.sim.plant.pair_state import (
    PairParameters,
    PairState,
    pair_forces_mN,
    set_arm_voltage,
    start_pair,
)
from pincette.sim.plant.parameters import plant_parameters
from pincette.sim.plant.plant import advance, left_alone
from pincette.sim.plant.state import Event, PlantState
from pincette.sim.rig.pair_commands import PairOrders, PairTimeline
from pincette.sim.rig.rig import TruthSink
from pincette.sim.rig.sensor_view import reading_um
from pincette.sim.rig.wave import NANOSECONDS

NO_WAVES = ValueError("a simulated rig of two arms cannot play or acquire waves")
NOISE_STREAMS = (0, 2)
"""Random streams of the readings of each arm; 1 is that of captured samples."""


@dataclass(frozen=True, slots=True)
class PairSnapshot:
    """True values at one time."""

    time_s: float
    tips_um: Pair
    forces_mN: Pair
    voltages_V: Pair
    """Voltages at the amplifiers' inputs, in V."""
    part_um: float
    part_present: bool
    events: tuple[Event, ...]


class SimulatedPair(PairOrders):
    """Two arms in simulated time; raises ValueError.

    Time passes as in ``SimulatedRig``. In lockstep a tick ends once both voltages are written: both
    old voltages apply for ``actuation_delay_s`` and both new ones for the rest of the period.
    """

    def __init__(
        self,
        simulation: Simulation,
        outputs: tuple[Simulation, Simulation],
        period_s: float,
        lockstep: bool,
        clock: Callable[[], float],
        truth: TruthSink | None = None,
    ) -> None:
        """Create a pair.

        ``outputs`` are the simulations of each arm, with resolved output step and lag.
        """
        if lockstep and simulation.actuation_delay_s > period_s:
            raise ValueError(
                f"actuation_delay_s = {simulation.actuation_delay_s} s is above the period, "
                f"{period_s} s"
            )
        parameters = pair_parameters(simulation, outputs)
        self._timeline = PairTimeline(parameters, start_pair(parameters))
        self._simulations, self._delay_s = outputs, simulation.actuation_delay_s
        self._period_s, self._lockstep, self._clock, self._truth = period_s, lockstep, clock, truth
        self._noise = [GaussianNoise(simulation.seed, stream) for stream in NOISE_STREAMS]
        self._began_s = self._reached_s = 0.0 if lockstep else clock()
        self._looks = [0, 0]
        self._ticks = 0
        self._sample: PairState | None = None
        self._written_V: dict[int, float] = {}
        """Voltages written in the present tick, by arm, in V; in lockstep."""
        self._due_V: Pair | None = None
        """Voltages that have ended a tick through which the plant must still be advanced, in V; in
        lockstep."""
        self._lock = threading.Lock()
        if not simulation.bead:
            self.remove_part()

    def now_s(self) -> float:
        """Return the rig's time in s: simulated in lockstep, that of the clock in real time."""
        return self._ticks * self._period_s if self._lockstep else self._clock()

    def measure_um(self, arm: int) -> float:
        """Return the position of an arm, 0 or 1, with its sensor's noise, rounded to its step."""
        with self._present() as timeline:
            self._sample = self._sample or timeline.state
            index = self._ticks if self._lockstep else self._looks[arm]
            self._looks[arm] += 1
            x_um, now_s = timeline.state.tips_um[arm], timeline.time_ns * 1e-9
            return reading_um(self._simulations[arm], x_um, now_s, self._noise[arm].at, index)

    def put_out(self, arm: int, voltage_V: float) -> None:
        """Output the voltage of an arm; in lockstep, the second voltage ends the tick."""
        with self._present() as timeline:
            if not self._lockstep:
                timeline.state = set_arm_voltage(
                    timeline.parameters, timeline.state, arm, voltage_V
                )
                if arm == 1:
                    self._end_tick(timeline.state)
                else:  # reported again with the second: a watchdog may have changed only this arm
                    self._tell(self._ticks, self._sample or timeline.state, timeline.state)
                return
            self._written_V[arm] = voltage_V
            if len(self._written_V) == 2:
                self._due_V, self._written_V = (self._written_V[0], self._written_V[1]), {}
                self._end_tick(timeline.state)

    def pass_time(self) -> None:
        """Advance the plant through the tick that the writes have ended; in lockstep only."""
        if self._lockstep:
            with self._present():
                pass

    def snapshot(self) -> PairSnapshot:
        """Return the present true values."""
        with self._present() as timeline:
            state = timeline.state
            return PairSnapshot(
                self._began_s + timeline.time_ns * 1e-9,
                state.tips_um,
                pair_forces_mN(timeline.parameters, state),
                (state.first.voltage_V, state.second.voltage_V),
                state.part_um,
                state.part == "there",
                tuple(self._dated(event) for event in state.events),
            )

    def events(self) -> list[Event]:
        """Return the events of the rig so far, with times on its own clock."""
        return list(self.snapshot().events)

    def arm_states(self) -> tuple[PlantState, ...]:
        """Return the present state of both arms."""
        with self._present() as timeline:
            return timeline.state.first, timeline.state.second

    def resume(self, arms: tuple[PlantState, ...], away_s: float) -> None:
        """Continue with two arms that were simulated before.

        Raises ValueError unless there are two.

        Both outputs were at 0 V for ``away_s``. The part lies at its position in the rig file.
        """
        with self._present() as timeline:
            # Without the part each arm moves independently.
            first, second = (
                advance(p, left_alone(arm), away_s)
                for p, arm in zip(timeline.parameters.arms, arms, strict=True)
            )
            timeline.state = replace(timeline.state, first=first, second=second)

    @contextmanager
    def _present(self) -> Generator[PairTimeline]:
        """Provide the present state of both arms under the lock."""
        with self._lock:
            self._catch_up()
            yield self._timeline

    def _end_tick(self, now: PairState) -> None:
        seq, sample = self._ticks, self._sample or now
        self._ticks, self._sample = self._ticks + 1, None
        self._tell(seq, sample, now)

    def _tell(self, seq: int, sample: PairState, now: PairState) -> None:
        if self._truth is None:
            return
        parameters = self._timeline.parameters
        (x_1, x_2), (force_1, force_2) = sample.tips_um, pair_forces_mN(parameters, sample)
        wanted_V = self._due_V or (now.first.target_V, now.second.target_V)
        u_1, u_2 = (quantised_V(arm, u) for arm, u in zip(parameters.arms, wanted_V, strict=True))
        part_um = sample.part_um if sample.part == "there" else None
        arms = ArmTruth(x_1, force_1, u_1), ArmTruth(x_2, force_2, u_2)
        self._truth(GroundTruth(seq, arms, part_um))

    def _catch_up(self) -> None:
        timeline = self._timeline
        if self._lockstep:
            voltages_V, self._due_V = self._due_V, None
            if voltages_V is None:
                return
            begin_s, delay_s = (self._ticks - 1) * self._period_s, self._delay_s
            timeline.pass_to(round((begin_s + delay_s) * NANOSECONDS), delay_s)
            for arm, voltage_V in enumerate(voltages_V):
                timeline.state = set_arm_voltage(
                    timeline.parameters, timeline.state, arm, voltage_V
                )
            end_ns = round(self._ticks * self._period_s * NANOSECONDS)
            timeline.pass_to(end_ns, self._period_s - delay_s)
            return
        now_s = self._clock()
        if now_s > self._reached_s:
            end_ns = round((now_s - self._began_s) * NANOSECONDS)
            timeline.pass_to(end_ns, now_s - self._reached_s)
            self._reached_s = now_s

    def _dated(self, event: Event) -> Event:
        return event._replace(time_s=self._began_s + event.time_s)


@dataclass(frozen=True, slots=True)
class ArmOfPair:
    """One arm of a pair, as seen by its instruments."""

    pair: SimulatedPair
    arm: int
    """Index of the arm, 0 or 1."""

    def measure_um(self) -> float:
        """Return the reading of this arm's sensor, in µm."""
        return self.pair.measure_um(self.arm)

    def put_out(self, voltage_V: float) -> None:
        """Output the voltage of this arm."""
        self.pair.put_out(self.arm, voltage_V)

    def now_s(self) -> float:
        """Return the time on the rig's clock, in s."""
        return self.pair.now_s()

    def set_averaging(self, averaging_s: float) -> None:
        """Reject averaging: the sensors of a simulated pair show the position itself."""
        if averaging_s:
            raise ValueError(f"averaging_s = {averaging_s} s: the sensors of a pair do not average")

    @property
    def wave_over(self) -> bool:
        """Return True, since a pair plays no waveforms."""
        return True

    def end_capture(self) -> None:
        """Do nothing, since a pair has no capture."""

    def put_out_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:  # noqa: ARG002
        """Reject a waveform, since it would end the tick for only one arm."""
        raise NO_WAVES

    def extend_wave(self, voltages_V: Sequence[float]) -> None:  # noqa: ARG002
        """Reject the extension of a waveform."""
        raise NO_WAVES

    def go_on(self) -> None:
        """Reject a tick without a write."""
        raise NO_WAVES

    def begin_capture(self, rate_hz: float) -> None:  # noqa: ARG002
        """Reject a capture."""
        raise NO_WAVES

    def drain(self) -> tuple[list[float], list[float]]:
        """Reject reading a capture."""
        raise NO_WAVES


def pair_parameters(
    simulation: Simulation, outputs: tuple[Simulation, Simulation]
) -> PairParameters:
    """Return both arms and the part between them, from tables of a rig file; raises ValueError."""
    if any(one.averaging_s for one in outputs):
        raise ValueError("averaging_s: the sensors of a pair do not average; omit it")
    if simulation.passive_natural_frequency_rad_per_s is not None:
        raise ValueError("passive_natural_frequency_rad_per_s: a pair has no passive arm")
    arms = [plant_parameters(one.model_copy(update={"bead": True})) for one in outputs]
    between = simulation.pair_of_arms
    first_um, second_um = outputs[0].bead_contact_um, outputs[1].bead_contact_um
    part = structs.replace(arms[0].part, hertz_um_per_mN23=0.0, pull_off_mN=0.0)
    return PairParameters(
        arms[0],
        arms[1],
        gap_um=first_um + second_um,
        part_um=first_um,
        face_mN_per_um=between.face_mN_per_um,
        ground_mN_per_um=between.ground_mN_per_um,
        ground_slip_mN=between.ground_slip_mN,
        part=part,
        pull_off_mN=between.pull_off_mN,
        lands=between.lands,
    )
