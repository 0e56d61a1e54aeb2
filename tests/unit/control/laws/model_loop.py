"""A closed loop of a law and an arm that satisfies (4), free or against a spring F = K_e·(x -
x_e)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pincette.control.arm.plant import ArmParameters, DifferenceEquation, consistent_arm, discretize
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.law import Law, LawState, build, rebase, start
from pincette.control.laws.sliding import LawOutput
from tests.support.laws import step_at

ARM = consistent_arm(2437.8, 0.026, 19.0, 0.46)
SCHEMES: tuple[Literal["pbsmic", "dsmifc"], ...] = ("pbsmic", "dsmifc")


def law_of(settings: LawSettings, period_s: float = 0.02, filter_s: float = 0.0) -> Law:
    """Return a law with the parameters of ``ARM``, unless its set is the printed one."""
    return build(settings, ARM, period_s, filter_s)


@dataclass
class ModelArm:
    """Position and force after the voltage has acted: (4) solved with F_k = K_e·(x_k - x_e)."""

    plant: DifferenceEquation
    K_e: float = 0.0
    x_e_um: float = 0.0
    x_um: float = 0.0
    x_1_um: float = 0.0
    voltage_V: float = 0.0

    @property
    def force_mN(self) -> float:
        return self.K_e * (self.x_um - self.x_e_um)

    def drive(self, voltage_V: float, p_mN: float = 0.0) -> None:
        plant = self.plant
        x_um = (
            plant.d_bar * voltage_V
            + p_mN
            + self.K_e * self.x_e_um
            - plant.b_bar * self.x_um
            - plant.m_bar * self.x_1_um
        ) / (plant.k_bar + self.K_e)
        self.x_um, self.x_1_um, self.voltage_V = x_um, self.x_um, voltage_V


def resting_arm(
    x_um: float,
    period_s: float = 0.02,
    *,
    K_e: float = 0.0,
    x_e_um: float = 0.0,
    arm: ArmParameters = ARM,
) -> ModelArm:
    """Return an arm at rest, with the voltage that keeps it there."""
    voltage_V = (arm.k * x_um + K_e * (x_um - x_e_um)) / arm.d
    return ModelArm(discretize(arm, period_s), K_e, x_e_um, x_um, x_um, voltage_V)


class Loop:
    """Law and arm, tick by tick; the law is fed the arm's true force of the newest sample."""

    def __init__(self, law: Law, arm: ModelArm, *, high_V: float = 1e9) -> None:
        self.law, self.arm, self.high_V = law, arm, high_V
        self.x_r_um, self.force_r_mN = arm.x_um, arm.force_mN
        self.state: LawState = start(
            law,
            x_um=arm.x_um,
            x_r_um=arm.x_um,
            force_mN=arm.force_mN,
            applied_V=arm.voltage_V,
        )

    def tick(
        self,
        x_r_um: float,
        force_r_mN: float = 0.0,
        *,
        limited: int = 0,
        p_mN: float = 0.0,
        noise_mN: float = 0.0,
    ) -> LawOutput:
        self.state, output = step_at(
            self.law,
            self.state,
            (self.arm.x_um, self.arm.force_mN + noise_mN, self.arm.voltage_V),
            (x_r_um, force_r_mN),
            limited=limited,
        )
        self.arm.drive(min(output.voltage_V, self.high_V), p_mN)
        self.x_r_um, self.force_r_mN = x_r_um, force_r_mN
        return output

    def updated(self, plan: Sequence[tuple[float, float]]) -> list[LawOutput]:
        return [self.tick(x_r_um, force_r_mN) for x_r_um, force_r_mN in plan]

    def change(self, law: Law) -> None:
        """Continue with another law, whose references continue as well."""
        self.law = law
        self.state = rebase(
            law,
            self.state,
            x_um=self.arm.x_um,
            x_r_um=self.x_r_um,
            force_mN=self.arm.force_mN,
            force_r_mN=self.force_r_mN,
        )
