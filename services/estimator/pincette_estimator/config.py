"""What the estimator takes from the rig file."""

from dataclasses import dataclass

from pincette.config import RigFile
from pincette.control.force import ZeroLimits
from pincette.control.plant import (
    DifferenceEquation,
    consistent_arm,
    discretize,
    printed_arm,
)


@dataclass(frozen=True, slots=True)
class EstimatorConfig:
    """The arm as identified, and what its free response is trusted for."""

    period_s: float
    plant: DifferenceEquation
    piezo_um_per_V: float
    compliance_um_per_mN: float
    noise_um: float
    hysteresis_fraction: float
    creep_mN_per_decade: float
    zero_limits: ZeroLimits


def configure(rig: RigFile) -> EstimatorConfig:
    """Take the estimator's part of a rig file."""
    model = rig.model
    arm = (
        printed_arm()
        if model.parameters == "printed"
        else consistent_arm(
            model.natural_frequency_rad_per_s,
            model.damping_ratio,
            model.piezo_um_per_V,
            model.compliance_um_per_mN,
        )
    )
    return EstimatorConfig(
        period_s=rig.rig.period_s,
        plant=discretize(arm, rig.rig.period_s),
        piezo_um_per_V=model.piezo_um_per_V,
        compliance_um_per_mN=model.compliance_um_per_mN,
        noise_um=rig.sensor.noise_um,
        hysteresis_fraction=model.hysteresis_fraction,
        creep_mN_per_decade=model.creep_mN_per_decade,
        zero_limits=ZeroLimits(),
    )
