"""Two simulated arms under the law of two arms, tick by tick, as they are read and driven."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from pincette.config import RigFile, derived
from pincette.control.arm.plant import ArmParameters, OutputTiming, consistent_arm
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
from pincette.sim.plant.plant import plant_parameters
from pincette.sim.rig.sensor_view import reading_um
from pincette_study.pairs import TaughtPair
from pincette_study.rigs import simulation_of


@dataclass(frozen=True, slots=True)
class Instruments:
    """What reads and drives both arms."""

    period_s: float
    delay_s: float
    """From a sample to its voltages."""
    lag_s: float
    output_step_V: float
    sensor_step_um: float
    substep_s: float
    slew_V_per_s: float


SLOW = Instruments(0.02, 0.005, 0.0033, 0.001220703125, 0.025, 0.001, 50.0)
"""Those of ``demo.toml``."""
FAST = Instruments(0.001, 0.00065, 0.0, 0.00030517578125, 0.003, 0.00025, 60.0)
"""Those of ``kilohertz.toml``."""


@dataclass(frozen=True, slots=True)
class Tick:
    """One sample: what was read, what was wanted of it, and what was true."""

    wanted: TwoArmReferences | None
    """References that this sample was to meet, given a tick before; None of arms that were led
    by their voltages."""
    tips_um: Pair
    forces_mN: Pair
    """Of each arm's estimator."""
    true_tips_um: Pair
    true_forces_mN: Pair
    part_um: float
    voltages_V: Pair
    """Applied from this tick on."""


class PairBench:
    """A pair from the moment it is switched on; each tick reads both arms and drives both."""

    def __init__(
        self,
        pair: TaughtPair,
        instruments: Instruments,
        part: Callable[[PairParameters], PairParameters],
        gains: dict[str, float] | None = None,
    ) -> None:
        self.instruments, self.pair = instruments, pair
        self.plant = part(_plant(pair, instruments))
        self.state: PairState = start_pair(self.plant)
        self.ticks: list[Tick] = []
        self._noise = [GaussianNoise(pair.number, stream) for stream in (1, 2)]
        self._models: list[HysteresisModel] = [_model(rig) for rig in pair.arms]
        self._memories: list[HysteresisState] = [at_rest(model) for model in self._models]
        self._voltages_V: Pair = (0.0, 0.0)
        self._wanted: TwoArmReferences | None = None
        output = OutputTiming(instruments.delay_s, instruments.lag_s)
        first, second = (arm_of(rig) for rig in pair.arms)
        omega_n = (first.k / first.m) ** 0.5
        self.law = two_arms.build(
            (first, second),
            gains or two_arms.default_gains(omega_n, instruments.period_s),
            instruments.period_s,
            2.0 / self.plant.face_mN_per_um,
            output,
        )
        self._law_state = two_arms.start()
        self.offsets_um: list[float] = [0.0, 0.0]
        self._observers = [
            QuasiStatic(
                QuasiStaticParameters(1.0 / arm.k, older=self.law.older, lag=self.law.lag_kept)
            )
            for arm in (first, second)
        ]

    @property
    def disagreement_mN(self) -> float:
        """F̂_1 - F̂_2 of the newest sample."""
        force_1, force_2 = self.ticks[-1].forces_mN
        return force_1 - force_2

    def drive(self, voltages_V: Callable[[], Pair]) -> None:
        """One tick without a law; the voltages are asked for after the sample."""
        self._sample()
        self._put(voltages_V())
        self._wanted = None

    def lead(self, references: TwoArmReferences) -> two_arms.TwoArmOutput:
        """One tick under the law."""
        tick = self._sample()
        free_1, free_2 = (
            displacement_um(model, memory)
            for model, memory in zip(self._models, self._memories, strict=True)
        )
        self._law_state, output = two_arms.step(
            self.law,
            self._law_state,
            tips_um=tick.tips_um,
            free_um=(free_1, free_2),
            forces_mN=tick.forces_mN,
            references=references,
        )
        V_1, V_2 = (
            voltage_for(
                model,
                memory,
                free_um,
                um_per_V=rig.model.piezo_um_per_V,
                period_s=self.instruments.period_s,
            )
            for rig, model, memory, free_um in zip(
                self.pair.arms, self._models, self._memories, output.free_um, strict=True
            )
        )
        self._put((V_1, V_2))
        self._wanted = references
        return output

    def zero(self, ticks: int) -> None:
        """Rest free of the part, and take both forces for 0."""
        begin = len(self.ticks)
        away: list[Pair] = []
        for _ in range(ticks):
            self.drive(lambda: self._voltages_V)
            one, two = (
                displacement_um(model, memory)
                for model, memory in zip(self._models, self._memories, strict=True)
            )
            away.append((one, two))
        for arm in range(2):
            seen = [tick.tips_um[arm] for tick in self.ticks[begin:]]
            # The memory is led on after the sample: each reading belongs to the one before.
            known = [pair[arm] for pair in away]
            self.offsets_um[arm] = (sum(seen[1:]) - sum(known[:-1])) / (ticks - 1)

    def without_part(self) -> None:
        """Take the part away."""
        self.state = remove_pair_part(self.state)

    def with_part(self) -> None:
        """Put the part back where it lay."""
        at_um = self.plant.part_um
        self.state = replace(
            self.state, part="there", contact=APART, part_um=at_um, anchor_um=at_um
        )

    def _sample(self) -> Tick:
        index, state = len(self.ticks), self.state
        now_s = index * self.instruments.period_s
        tips: list[float] = []
        forces: list[float] = []
        for arm, (rig, x_um) in enumerate(zip(self.pair.arms, state.tips_um, strict=True)):
            simulation = simulation_of(rig).model_copy(
                update={"sensor_step_um": self.instruments.sensor_step_um}
            )
            tips.append(reading_um(simulation, x_um, now_s, self._noise[arm].at, index))
            free_um = self.offsets_um[arm] + displacement_um(self._models[arm], self._memories[arm])
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

    def _put(self, wanted_V: Pair) -> None:
        """Put both voltages out within the limits, and let the period pass."""
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


def arm_of(rig: RigFile) -> ArmParameters:
    """m, b, k, d of an arm as its rig file has them."""
    model = rig.model
    return consistent_arm(
        model.natural_frequency_rad_per_s,
        model.damping_ratio,
        model.piezo_um_per_V,
        model.compliance_um_per_mN,
    )


def _model(rig: RigFile) -> HysteresisModel:
    response = derived.free_response(rig.model)
    model = getattr(response, "model", None)
    if not isinstance(model, HysteresisModel):
        raise TypeError("an arm of a pair needs an identified free response: teach it")
    return model


def _plant(pair: TaughtPair, made: Instruments) -> PairParameters:
    first, second = (
        plant_parameters(
            simulation_of(rig).model_copy(
                update={
                    "output_step_V": made.output_step_V,
                    "output_lag_s": made.lag_s,
                    "substep_s": made.substep_s,
                }
            )
        )
        for rig in pair.arms
    )
    near_um, far_um = pair.contacts_um
    return PairParameters(first, second, near_um + far_um, near_um)
