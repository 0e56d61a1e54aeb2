"""Two simulated arms controlled by the law of two arms, measured and driven tick by tick."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from pincette.control.arm.plant import OutputTiming
from pincette.control.force.observers import QuasiStatic, QuasiStaticParameters
from pincette.control.laws import two_arms
from pincette.control.laws.two_arms import Pair, TwoArmReferences
from pincette.control.response.hysteresis import (
    HysteresisModel,
    HysteresisState,
    displacement_um,
    step,
)
from pincette.control.response.hysteresis import start as at_rest
from pincette.control.response.inverse import voltage_for
from pincette.control.stability.two_arms import TwoArmLoop
from pincette.sim.plant.noise import GaussianNoise
from pincette.sim.plant.pair import advance_pair
from pincette.sim.plant.pair_state import (
    APART,
    PairParameters,
    PairState,
    pair_forces_mN,
    remove_pair_part,
    set_pair_voltages,
    start_pair,
)
from pincette.sim.rig.sensor_view import reading_um
from pincette_study.rigs import simulation_of
from pincette_study.two_arms.pairs import Instruments, TaughtPair, arm_of, model_of, plant_of

Series = NDArray[np.float64]
Table = list[Pair]
"""Model errors of both arms in µm, for each tick of a phase."""
SMOOTH_S = {0.02: 0.1, 0.001: 0.015}
"""Standard deviation in s of the smoothing of ``Table``, by period in s: five samples of a slow
pair, fifteen samples of a fast one."""


@dataclass(frozen=True, slots=True)
class Tick:
    """One sample: readings, references, and true values."""

    wanted: TwoArmReferences | None
    """References for this sample, given one tick earlier; None if the voltages were given
    directly."""
    tips_um: Pair
    forces_mN: Pair
    """Force from each arm's estimator, in mN."""
    true_tips_um: Pair
    true_forces_mN: Pair
    part_um: float
    voltages_V: Pair
    """Voltages applied from this tick, in V."""


class PairBench:
    """Pair of arms from the moment it is switched on; each tick measures and drives both arms."""

    def __init__(
        self,
        pair: TaughtPair,
        instruments: Instruments,
        part: Callable[[PairParameters], PairParameters],
        known: Mapping[str, Table] | None = None,
        run: int = 1,
    ) -> None:
        self.instruments, self.pair = instruments, pair
        self.begun: dict[str, int] = {}
        self._part, self._run = part, run
        self._known = known or {}
        self._missed: Table = []
        self._phase_index = 0
        self.plant = part(plant_of(pair, instruments))
        self.state: PairState = start_pair(self.plant)
        self.ticks: list[Tick] = []
        self.free_um: list[Pair] = []
        """Free positions of both models at each sample, in µm."""
        self._noise = [GaussianNoise(pair.number, 2 * run + arm) for arm in (0, 1)]
        self._models: list[HysteresisModel] = [model_of(rig) for rig in pair.arms]
        self._memories: list[HysteresisState] = [at_rest(model) for model in self._models]
        self._voltages_V: Pair = (0.0, 0.0)
        self._wanted: TwoArmReferences | None = None
        output = OutputTiming(instruments.delay_s, instruments.lag_s)
        arms = arm_of(pair.arms[0]), arm_of(pair.arms[1])
        part_um_per_mN = 2.0 / self.plant.face_mN_per_um
        gains = two_arms.default_gains((arms[0].k / arms[0].m) ** 0.5, instruments.period_s)
        self.loop = TwoArmLoop(
            arms, tuple(gains.items()), instruments.period_s, part_um_per_mN, output
        )
        self.law = two_arms.build(arms, gains, instruments.period_s, part_um_per_mN, output)
        self._law_state = two_arms.start()
        self.offsets_um: list[float] = [0.0, 0.0]
        self._observers = [
            QuasiStatic(
                QuasiStaticParameters(1.0 / arm.k, older=self.law.older, lag=self.law.lag_kept)
            )
            for arm in arms
        ]

    def begin(self, phase: str) -> None:
        """Begin a phase; its name selects the known model errors, if there are any."""
        self.begun[phase] = len(self.ticks)
        self._missed, self._phase_index = self._known.get(phase, []), len(self.ticks)

    def drive(self, voltages_V: Callable[[], Pair]) -> None:
        """Play one tick without a law; the voltages are output after the sample."""
        self._sample()
        self._put(voltages_V())
        self._wanted = None

    def lead(self, references: TwoArmReferences) -> two_arms.TwoArmOutput:
        """Play one tick under the law."""
        tick = self._sample()
        self._law_state, output = two_arms.step(
            self.law,
            self._law_state,
            tips_um=tick.tips_um,
            free_um=self.free_um[-1],
            forces_mN=tick.forces_mN,
            references=references,
        )
        # The response one period ahead is H plus its known error at that time.
        missed = self._missed_um()
        V_1, V_2 = (
            voltage_for(
                self._models[arm],
                self._memories[arm],
                output.free_um[arm] - missed[arm],
                um_per_V=self.pair.arms[arm].model.piezo_um_per_V,
                period_s=self.instruments.period_s,
            )
            for arm in (0, 1)
        )
        self._put((V_1, V_2))
        self._wanted = references
        return output

    def zero(self, ticks: int) -> None:
        """Rest free of the part, and zero both forces."""
        self.begin("zero")
        for _ in range(ticks):
            self.drive(lambda: self._voltages_V)
        for arm in (0, 1):
            seen = sum(tick.tips_um[arm] for tick in self.ticks[-ticks:])
            self.offsets_um[arm] = (seen - sum(pair[arm] for pair in self.free_um[-ticks:])) / ticks
        self.begin("close")

    def without_part(self) -> None:
        """Remove the part."""
        self.state = remove_pair_part(self.state)

    def with_part(self) -> None:
        """Put the part back at its position."""
        at_um = self.plant.part_um
        self.state = structs.replace(
            self.state, part="there", contact=APART, part_um=at_um, anchor_um=at_um
        )

    def replayed(self) -> dict[str, Table]:
        """Repeat the voltages from a new start without the part; return the errors of the free
        response H.

        The errors are given by phase and tick, smoothed, and relative to their mean over the zero.
        """
        other = PairBench(self.pair, self.instruments, self._part, run=self._run + 10)
        other.without_part()
        voltages = [tick.voltages_V for tick in self.ticks[1:]] + [self._voltages_V]
        missed: list[Pair] = []
        for voltages_V in voltages:
            other.drive(lambda: voltages_V)  # noqa: B023  asked for at once
        for tick, free_um in zip(other.ticks, other.free_um, strict=True):
            missed.append((tick.tips_um[0] - free_um[0], tick.tips_um[1] - free_um[1]))
        values = np.array(missed)
        zero = slice(self.begun["zero"], self.begun["close"])
        smooth = _smoothed(
            values - np.mean(values[zero], axis=0),
            SMOOTH_S[self.instruments.period_s] / self.instruments.period_s,
        )
        ends = [*self.begun.values(), len(values)]
        return {
            phase: [(float(one), float(two)) for one, two in smooth[begin : ends[place + 1]]]
            for place, (phase, begin) in enumerate(self.begun.items())
            if phase in ("press", "track")
        }

    def _sample(self) -> Tick:
        index, state = len(self.ticks), self.state
        now_s = index * self.instruments.period_s
        missed = self._missed_um()
        one, two = (
            displacement_um(self._models[arm], self._memories[arm]) + missed[arm] for arm in (0, 1)
        )
        self.free_um.append((one, two))
        tips: list[float] = []
        forces: list[float] = []
        for arm, (rig, x_um) in enumerate(zip(self.pair.arms, state.tips_um, strict=True)):
            simulation = simulation_of(rig).model_copy(
                update={"sensor_step_um": self.instruments.sensor_step_um}
            )
            tips.append(reading_um(simulation, x_um, now_s, self._noise[arm].at, index))
            free_um = self.offsets_um[arm] + self.free_um[index][arm]
            voltage_V = self._voltages_V[arm]
            if not index:
                self._observers[arm] = self._observers[arm].restart(tips[arm], free_um, voltage_V)
            self._observers[arm], force_mN = self._observers[arm].observe(
                tips[arm], free_um, voltage_V
            )
            forces.append(force_mN)
        tick = Tick(
            wanted=self._wanted,
            tips_um=(tips[0], tips[1]),
            forces_mN=(forces[0], forces[1]),
            true_tips_um=state.tips_um,
            true_forces_mN=pair_forces_mN(self.plant, state),
            part_um=state.part_um,
            voltages_V=self._voltages_V,
        )
        self.ticks.append(tick)
        return tick

    def _missed_um(self) -> Pair:
        """Return the known model errors of the next sample, in µm."""
        if not self._missed:
            return 0.0, 0.0
        place = len(self.ticks) - self._phase_index
        return self._missed[min(place, len(self._missed) - 1)]

    def _put(self, wanted_V: Pair) -> None:
        """Output both voltages within the limits, and let the period pass."""
        made = self.instruments
        reach_V = made.slew_V_per_s * made.period_s
        voltages: list[float] = []
        for rig, u, before in zip(self.pair.arms, wanted_V, self._voltages_V, strict=True):
            limits = rig.limits
            within = max(limits.voltage_min_V, min(limits.voltage_max_V, u))
            within = max(before - reach_V, min(before + reach_V, within))
            voltages.append(round(within / made.output_step_V) * made.output_step_V)
        self.state = advance_pair(self.plant, self.state, made.delay_s)
        self.state = set_pair_voltages(self.plant, self.state, (voltages[0], voltages[1]))
        self.state = advance_pair(self.plant, self.state, made.period_s - made.delay_s)
        self._voltages_V = voltages[0], voltages[1]
        self._memories = [
            step(model, memory, u, made.period_s)
            for model, memory, u in zip(self._models, self._memories, voltages, strict=True)
        ]


def _smoothed(values: Series, ticks: float) -> Series:
    """Return columns smoothed by a Gaussian of a width in ticks, with constant ends."""
    reach = round(4.0 * ticks)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / ticks) ** 2)
    padded = np.pad(values, ((reach, reach), (0, 0)), mode="edge")
    columns = [np.convolve(column, weights / np.sum(weights), mode="valid") for column in padded.T]
    return np.array(columns).T
