"""The controller's step in closed loop with an arm that satisfies (4), and a part at ``X_E_UM``."""

from dataclasses import dataclass

from msgspec.structs import replace

from pincette.control.arm.plant import PROMPT, consistent_arm, discretize
from pincette.control.force.position_steps import StepLimits
from pincette.control.laws.definition import LawSettings
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Move, Press, Rest, Seek
from pincette.control.response.free_response import FreeSample, nominal_response
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.voltage import VoltageLimits
from pincette.core.messages import Arm, Command, Estimate, Load, Telemetry
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.config import ArmConfig, ControllerConfig
from pincette_controller.step import Inputs, State, handle, start, step
from tests.support.arms import with_arm
from tests.support.laws import LAWS, law_settings

T, K_E, X_E_UM = 0.02, 2.0, 12.0
ARM = consistent_arm(2437.8, 0.026, 19.0, 0.46)
CONFIG = ControllerConfig(
    period_s=T,
    arms=(
        ArmConfig(
            ARM,
            nominal_response(19.0, FreeSample(0.0, 0.0)),
            MonitorLimits(T, 50.0, 3, 10.0, 0.1, 5, -29.0, 79.0, 3),
            VoltageLimits(-1.0, 4.0, 0.2, 0.1),
        ),
    ),
    law=law_settings(K_P=2.0),
    installed=LAWS,
    force_filter_s=0.03,
    output=PROMPT,
    steps=StepLimits(0.03, 0.46, T),
    part_um_per_mN=0.0,
)
GUARDS = Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.5, 1.0)
PBSMIC, DSMIFC = law_settings("pbsmic", K_P=2.0), law_settings("dsmifc", K_P=2.0)
QUIET = Estimate(
    epoch=1,
    seq=0,
    applied_seq=-1,
    tripped=False,
    degraded=False,
    arms=(
        ArmEstimate(
            x_um=0.0,
            force_mN=0.0,
            force_uncertainty_mN=0.1,
            perturbation_mN=0.0,
            zero_age_s=None,
            zero_refusal=None,
            applied_V=0.0,
            limits_active=0,
        ),
    ),
    valid=True,
)


def program(laws: tuple[LawSettings, ...] = (), **of: int) -> Program:
    """Return a grip; ``of`` names the law of a phase."""
    segments = (
        Rest("zero", 0.1),
        Move("approach", 0.6, to_um=(10.0,)),
        Seek("contact", 1.0, to_um=(14.0,)),
        Press("load", 0.6, to_mN=20.0),
        Press("hold", 0.4, to_mN=20.0, move_s=0.2),
        Press("unload", 0.6, to_mN=0.0),
        Move("retreat", 0.6, to_um=(0.0,)),
    )
    chosen = tuple(replace(segment, law=of.get(segment.phase, 0)) for segment in segments)
    return Program(chosen, GUARDS, K_E, tuple(law.spec() for law in laws))


@dataclass(frozen=True, slots=True)
class Tick:
    estimate: Estimate
    command: Command
    telemetry: Telemetry


class Bench:
    """Plays a program to its end, sample by sample."""

    def __init__(self, plays: Program, config: ControllerConfig = CONFIG) -> None:
        self.config = config
        self.plant = discretize(config.arms[0].parameters, T)
        state, _, _ = handle(config, start(config), Load(plays), 0.0)
        self.state: State = handle(config, state, Arm(1, 5, ""), 0.0)[0]
        self.x_um: float = 0.0
        self.x_1_um: float = 0.0
        self.force_mN: float = 0.0
        self.applied_V: float = 0.0
        self.seq: int = 0
        self.zero_seq: int | None = None
        self.ticks: list[Tick] = []

    def estimate(self) -> Estimate:
        age_s = None if self.zero_seq is None else T * (self.seq - self.zero_seq)
        return with_arm(
            QUIET,
            seq=self.seq,
            applied_seq=self.seq - 1,
            x_um=self.x_um,
            force_mN=self.force_mN,
            applied_V=self.applied_V,
            zero_age_s=age_s,
        )

    def tick(self) -> Tick:
        estimate = self.estimate()
        self.state, outputs = step(self.config, self.state, Inputs(estimate), 0.0)
        command, telemetry = outputs
        assert isinstance(command, Command)
        assert isinstance(telemetry, Telemetry)
        self._drive(command.arms[0].voltage_V)
        self.seq += 1
        if command.zero:
            self.zero_seq = self.seq
        self.ticks.append(Tick(estimate, command, telemetry))
        return self.ticks[-1]

    def until(self, phase: str = "") -> Tick:
        """Continue to the first tick of a phase, or to the end."""
        for _ in range(500):
            tick = self.tick()
            if tick.command.final or tick.telemetry.phase == phase:
                return tick
        raise AssertionError(f"{phase or 'the end'} was not reached")

    def _drive(self, voltage_V: float) -> None:
        plant = self.plant
        pushed_mN = plant.d_bar * voltage_V - plant.b_bar * self.x_um - plant.m_bar * self.x_1_um
        x_um = pushed_mN / plant.k_bar
        if x_um > X_E_UM:
            x_um = (pushed_mN + K_E * X_E_UM) / (plant.k_bar + K_E)
        self.x_um, self.x_1_um, self.applied_V = x_um, self.x_um, voltage_V
        self.force_mN = K_E * max(0.0, x_um - X_E_UM)
