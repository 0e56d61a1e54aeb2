"""What the estimator takes from the rig file."""

from dataclasses import dataclass

from pincette.config import Model, RigFile
from pincette.control.force import ZeroLimits, smoothing
from pincette.control.free_response import FreeResponse, FreeSample, nominal_response
from pincette.control.identified_response import identified_response
from pincette.control.plant import DifferenceEquation, discretize


@dataclass(frozen=True, slots=True)
class EstimatorConfig:
    """The arm as identified, and what its free response is trusted for."""

    period_s: float
    plant: DifferenceEquation
    response: FreeResponse
    """x_1 before anything has happened: the arm unpoled, at 0 V."""
    compliance_um_per_mN: float
    noise_um: float
    creep_mN_per_decade: float
    forgotten_mN: float
    forgotten_scale_V: float
    smoothing: float
    """Share by which the force follows each sample."""
    zero_limits: ZeroLimits


def configure(rig: RigFile) -> EstimatorConfig:
    """Take the estimator's part of a rig file."""
    model = rig.model
    return EstimatorConfig(
        period_s=rig.rig.period_s,
        plant=discretize(model.arm(), rig.rig.period_s),
        response=_response(model),
        compliance_um_per_mN=model.compliance_um_per_mN,
        noise_um=rig.sensor.noise_um,
        creep_mN_per_decade=model.creep_mN_per_decade,
        forgotten_mN=model.forgotten_mN,
        forgotten_scale_V=model.forgotten_scale_V,
        smoothing=smoothing(rig.rig.period_s, model.force_filter_s),
        zero_limits=ZeroLimits(),
    )


def _response(model: Model) -> FreeResponse:
    """The identified response where the rig file has one, a line elsewhere."""
    taught = model.free_response
    if taught is None:
        at_rest = FreeSample(0.0, 0.0)
        return nominal_response(model.piezo_um_per_V, at_rest, model.hysteresis_fraction)
    return identified_response(taught.hysteresis(), model.piezo_um_per_V, taught.residual_um)
