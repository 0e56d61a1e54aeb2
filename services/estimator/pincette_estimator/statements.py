"""Output of the estimator for a sample: the force with its uncertainty, or a fault."""

from math import hypot

from pincette.control.force.estimation import COVERAGE
from pincette.control.force.position_steps import mean_step_error_um
from pincette.core.faults import TRIPPED, Fault, FaultCode, fault
from pincette.core.messages import Applied, Estimate, Position
from pincette.core.messages.arms import ArmEstimate
from pincette_estimator.config import ArmConfig
from pincette_estimator.state import ArmState, touched
from pincette_estimator.uncertainty import stroke_uncertainty_mN, uncertainty_mN


def estimate(
    config: ArmConfig,
    state: ArmState,
    position: Position,
    applied: Applied,
    found_mN: tuple[float, float, float],
) -> Estimate:
    """Return the force of an arm at the newest sample.

    ``found_mN`` contains the force, its uncertainty and the perturbation. After a step of the
    position that the part or the sensor may have caused, the uncertainty also covers the force of
    the other cause.
    """
    F_mN, u_F_mN, p_mN = found_mN
    doubt_mN = 0.0
    if state.step_um:
        error_um = mean_step_error_um(config.sensor_noise_um)
        doubt_mN = (abs(state.step_um) + COVERAGE * error_um) / config.compliance_um_per_mN
    u_F_mN += doubt_mN
    x_um, output = position.arms[config.arm].x_um, applied.arms[config.arm]
    age_s = None if state.zero_s is None else position.seq * config.period_s - state.zero_s
    touch_x_um, touch_mN = touched(
        state,
        compliance_um_per_mN=config.compliance_um_per_mN,
        step_um=config.kink_limits.step_um,
        x_um=x_um,
        F_mN=F_mN,
        u_F_mN=u_F_mN,
    )
    arm = ArmEstimate(
        x_um=x_um,
        force_mN=F_mN,
        force_uncertainty_mN=u_F_mN,
        perturbation_mN=p_mN,
        zero_age_s=age_s,
        zero_refusal=state.zero_refusal,
        applied_V=output.voltage_V,
        limits_active=output.limits_active,
        touch_x_um=touch_x_um,
        touch_mN=touch_mN,
        stroke_change=None if state.stroke is None else state.stroke.change,
        stroke_limit=None if state.stroke is None else state.stroke.limit,
        zero_unconfirmed=state.zero_unconfirmed,
        force_doubt_mN=doubt_mN,
    )
    return Estimate(
        epoch=position.epoch,
        seq=position.seq,
        applied_seq=applied.seq,
        tripped=applied.state in TRIPPED,
        degraded=False,
        arms=(arm,),
        valid=True,
    )


def force_uncertainty_mN(config: ArmConfig, state: ArmState, seq: int, F_mN: float) -> float:
    """Return the expanded uncertainty of a force, in mN."""
    return hypot(
        uncertainty_mN(config, state, seq),
        COVERAGE * stroke_uncertainty_mN(state.response, F_mN),
    )


def degraded(
    config: ArmConfig, state: ArmState, position: Position, applied: Applied | None
) -> Estimate:
    """Return an estimate unfit for control, because the voltage or the measurement is missing."""
    x_um, (low_um, high_um) = position.arms[config.arm].x_um, config.position_um
    output = None if applied is None else applied.arms[config.arm]
    arm = ArmEstimate(
        x_um=x_um if low_um <= x_um <= high_um else 0.0,
        force_mN=0.0,
        force_uncertainty_mN=0.0,
        perturbation_mN=0.0,
        zero_age_s=None,
        zero_refusal=state.zero_refusal,
        applied_V=state.response.voltage_V if output is None else output.voltage_V,
        limits_active=0 if output is None else output.limits_active,
    )
    return Estimate(
        epoch=position.epoch,
        seq=position.seq,
        applied_seq=-1 if applied is None else applied.seq,
        tripped=applied is not None and applied.state in TRIPPED,
        degraded=applied is None,
        arms=(arm,),
        valid=False,
        fault=_fault(config, state, position, applied),
    )


def _fault(
    config: ArmConfig, state: ArmState, position: Position, applied: Applied | None
) -> Fault | None:
    """Return the reason why a sample yields no force; None if it yields one."""
    sample = position.arms[config.arm]
    if not sample.valid:
        return sample.fault
    low_um, high_um = config.position_um
    if not low_um <= sample.x_um <= high_um:
        return fault(
            FaultCode.POSITION_OUT_OF_RANGE,
            x_um=sample.x_um,
            minimum_um=low_um,
            maximum_um=high_um,
        )
    if stuck := state.stuck.fault:
        return stuck
    return fault(FaultCode.NO_APPLIED_VOLTAGE) if applied is None else None
