"""Configuration of the estimator from the rig file."""

from dataclasses import dataclass, replace

from pincette.config import RigFile, derived
from pincette.control.arm.plant import DifferenceEquation, discretize
from pincette.control.force.contact_detector import KinkLimits, kink_limits
from pincette.control.force.observers import ForceObserver
from pincette.control.force.ring import RingShares
from pincette.control.force.zeroing import ZeroLimits
from pincette.control.response.free_response import FreeResponse
from pincette.control.response.residual_table import ResidualTable
from pincette.control.response.reversal_memory import SMALL_V
from pincette.control.response.unknown_past import UnknownPast, unknown_past
from pincette_estimator.state import moved_V


@dataclass(frozen=True, slots=True)
class ArmConfig:
    """An identified arm, and the errors of its free response."""

    period_s: float
    unseen_V: float
    """Largest change of the voltage between two programs, in V, that the estimator may miss.

    In lockstep the last voltage of a program is not followed by a sample.
    """
    plant: DifferenceEquation
    response: FreeResponse
    """Free response x_1 before any motion: the unpoled arm at 0 V."""
    unknown: UnknownPast
    """Possible voltage history of an arm before the first program.

    A simulated arm that starts with the programs is new, but not every new arm is in the initial
    state of the model.
    """
    approach_tells: bool
    """True if the approach of a free arm reduces the uncertainty from an unknown history; see
    ``derived``."""
    residual: ResidualTable | None
    """Error of x_1 along the armed program; None if it was not measured."""
    observer: ForceObserver
    """Force observer of an arm at rest without a force."""
    compliance_um_per_mN: float
    noise_um: float
    """Standard deviation of s_p·F that the sensor's noise causes, in µm."""
    sensor_noise_um: float
    """Standard deviation of one reading, in µm."""
    creep_mN_per_decade: float
    creep_percent_per_decade: float
    """Creep per decade of time, in percent of a step; U grows by it beyond ``creep_known_s``."""
    creep_known_s: float
    """Age of a zero, in s, up to which x_1 includes the creep; infinite if x_1 models no creep."""
    forgotten_mN: float
    forgotten_scale_V: float
    return_error_um: float
    """Standard error of x_1 in a motion back, in µm; 0 if it was not measured."""
    turn_error_um_per_V: float
    """Standard error of the slope of x_1 just after a reversal, in µm/V; 0 if it was not
    measured."""
    ring_shares: RingShares
    """Contribution of the mode's ringing to the uncertainty of a position."""
    zero_limits: ZeroLimits
    kink_limits: KinkLimits
    part_stiffness_mN_per_um: float
    """Stiffness K_e of the planned part, in mN/µm."""
    stuck_V: float
    """Change of the voltage, in V, that the reading of a working sensor must show."""
    position_um: tuple[float, float]
    """Measuring range of the sensor, as positions of the arm, in µm."""
    voltage_V: tuple[float, float]
    """Voltages that are possible at all, in V: the range of the limits, extended by its own
    width on either side."""
    drift_um_per_s: float = 0.0
    """Largest drift of the sensor's reading, in µm/s."""
    moving: tuple[float, float] | None = None
    """Factors by which the arm's own voltage and the other arm's move a tip, while both arms hold a
    part: 1 - a and -a·d_j/d_i, with a = s_i/(s_1 + s_2 + 1/K_c). None for a single arm."""
    arm: int = 0
    """Index of this arm in messages."""


@dataclass(frozen=True, slots=True)
class EstimatorConfig:
    """The arms of a rig."""

    arms: tuple[ArmConfig, ...]


def configure(rig: RigFile) -> EstimatorConfig:
    """Read the estimator's settings from a rig file; raises ConfigError for an impossible
    observer.
    """
    arms = tuple(map(_of_arm, rig.arms))
    if len(arms) == 1:
        return EstimatorConfig(arms)
    models = [arm.model for arm in rig.arms]
    s_1, s_2 = (model.compliance_um_per_mN for model in models)
    squeeze = s_1 + s_2 + 1.0 / rig.part.stiffness_mN_per_um
    joint: list[ArmConfig] = []
    for index, (one, other) in enumerate(zip(models, reversed(models), strict=True)):
        share = one.compliance_um_per_mN / squeeze
        moving = 1.0 - share, -share * other.piezo_um_per_V / one.piezo_um_per_V
        joint.append(replace(arms[index], arm=index, moving=moving))
    return EstimatorConfig(tuple(joint))


def _of_arm(rig: RigFile) -> ArmConfig:
    model, part, period_s = rig.model, rig.part, rig.rig.period_s
    observer = derived.force_observer(rig)
    s_p = model.compliance_um_per_mN
    response = derived.free_response(model)
    unknown = unknown_past(response, (rig.limits.voltage_min_V, rig.limits.voltage_max_V))
    return ArmConfig(
        period_s=period_s,
        unseen_V=SMALL_V + (rig.limits.slew_V_per_s * period_s if rig.lockstep else 0.0),
        plant=discretize(model.arm(), period_s),
        response=response,
        unknown=unknown.judged(response),
        approach_tells=derived.approach_tells(rig),
        residual=derived.residual(model),
        observer=observer,
        compliance_um_per_mN=s_p,
        noise_um=rig.sensor.noise_um * observer.noise_gain,
        drift_um_per_s=rig.sensor.drift_um_per_min / 60.0,
        sensor_noise_um=rig.sensor.noise_um,
        creep_mN_per_decade=model.creep_mN_per_decade,
        creep_percent_per_decade=derived.creep_percent_per_decade(model),
        creep_known_s=derived.creep_known_s(model),
        forgotten_mN=model.forgotten_mN,
        forgotten_scale_V=model.forgotten_scale_V,
        return_error_um=derived.return_error_um(model),
        turn_error_um_per_V=derived.turn_error_um_per_V(model),
        ring_shares=derived.ring_shares(rig),
        zero_limits=ZeroLimits(
            rest_samples=derived.rest_samples(period_s),
            noise_um=rig.sensor.noise_um,
            first_touch_um=part.contact_um - part.contact_tolerance_um,
            touch_um=s_p * rig.grip.contact_force_mN,
        ),
        kink_limits=kink_limits(
            part.stiffness_mN_per_um * (1.0 - part.stiffness_tolerance), s_p, rig.sensor.noise_um
        ),
        part_stiffness_mN_per_um=part.stiffness_mN_per_um,
        stuck_V=moved_V(rig.sensor.noise_um, model.piezo_um_per_V),
        position_um=_positions_um(rig),
        voltage_V=_voltages_V(rig),
    )


def _positions_um(rig: RigFile) -> tuple[float, float]:
    sensor = rig.sensor
    ends_um = [
        sensor.direction * (end_um - sensor.offset_um)
        for end_um in (sensor.minimum_um, sensor.maximum_um)
    ]
    return min(ends_um), max(ends_um)


def _voltages_V(rig: RigFile) -> tuple[float, float]:
    low_V, high_V = rig.limits.voltage_min_V, rig.limits.voltage_max_V
    apart_V = high_V - low_V
    return low_V - apart_V, high_V + apart_V
