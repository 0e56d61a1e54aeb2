"""Quantities of control derived from a rig file: free response, observer, limits, planned rig.

Several programs need the same derived quantities, so each is computed only here.
"""

from math import hypot, inf, sqrt

from pincette.config.model import Model
from pincette.config.rig_file import RigFile
from pincette.config.toml_file import ConfigError
from pincette.control.arm.plant import OutputTiming
from pincette.control.force.freedom import FreeArm
from pincette.control.force.inverse_dynamics import inverse_dynamics
from pincette.control.force.kalman import augmented_kalman
from pincette.control.force.observers import (
    ForceObserver,
    QuasiStatic,
    QuasiStaticParameters,
    held_age,
    kept,
    least_period_s,
)
from pincette.control.force.position_steps import StepLimits
from pincette.control.force.ring import RingShares, shares_of_ring
from pincette.control.planning.conditioning import stroke_depth_V
from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.feasibility import PlanLimits, acceleration_limit
from pincette.control.response.conditioned_branch import STROKES
from pincette.control.response.free_response import FreeResponse, FreeSample, nominal_response
from pincette.control.response.hysteresis import HysteresisModel, HysteresisState
from pincette.control.response.identified_response import identified_response
from pincette.control.response.poled import poled
from pincette.control.response.recorded_response import recorded_response
from pincette.control.response.residual_table import ResidualTable

REST_S = 0.2
REST_SAMPLES = (10, 64)
"""Smallest and largest number of samples during the rest in which the force is zeroed."""
X_START_UM = 0.0
"""Position of the arm at zero voltage, which results from the sensor offset in the rig file."""

CHECK_UM, CHECK_NOISES = 2.0, 50.0
"""Smallest distance over which the program checks whether an arm is free: in µm, and as a multiple
of the sensor noise.
"""

CREEP_REACH = 10.0
"""Ratio of the age up to which creep is modelled to the longest identified creep time."""


def free_response(model: Model) -> FreeResponse:
    """Return x_1 at 0 V of an arm with unknown history: the identified response, or else a line.

    The arm is poled if the voltages of its identification are known, otherwise unpoled.
    """
    taught, recorded = model.free_response, model.recorded_response
    if recorded is not None:
        return recorded_response(recorded.branches(), model.piezo_um_per_V, recorded.residual_um)
    if taught is None:
        at_rest = FreeSample(0.0, 0.0)
        return nominal_response(model.piezo_um_per_V, at_rest, model.hysteresis_fraction)
    return identified_response(
        taught.hysteresis(),
        model.piezo_um_per_V,
        taught.residual_um,
        taught.growth(),
        begin_memory(model),
        None if taught.branch is None else taught.branch.branch(),
    )


def begin_memory(model: Model) -> HysteresisState | None:
    """Return the initial state of the free response; None means that of an unpoled arm."""
    taught = model.free_response
    if taught is None or taught.taught_V is None:
        return None
    from_above = taught.branch is not None
    return poled(taught.hysteresis(), taught.taught_V, from_above=from_above)


def conditioning_V(rig: RigFile) -> float | None:
    """Return the lowest voltage of the conditioning strokes; None if they are not possible."""
    taught = rig.model.free_response
    return stroke_depth_V(None if taught is None else taught.taught_V, rig.limits.voltage_min_V)


def approach_tells(rig: RigFile) -> bool:
    """Return whether the approach of a free arm may be used to narrow down its unknown history.

    The approach does not reveal the effect of the history on the force: arms with relay hysteresis
    approach in the same manner after histories whose forces differ by several mN. It is therefore
    not used if strokes can condition the arm, nor if the arm has no voltages below rest. It is used
    only for a model whose identification voltages are unknown.
    """
    taught = rig.model.free_response
    if rig.limits.voltage_min_V >= 0.0:
        return False
    return taught is None or (taught.taught_V is None and taught.branch is None)


def _strokes(model: Model) -> int:
    """Return the number of conditioning strokes before the measurement of the model in use."""
    branch = None if model.free_response is None else model.free_response.branch
    return STROKES if branch is None else branch.strokes


def identified_hysteresis(model: Model) -> HysteresisModel | None:
    """Return H, which replaces d·u in laws with the identified set; None if it has not been
    identified.
    """
    return None if model.free_response is None else model.free_response.hysteresis()


def rest_samples(period_s: float) -> int:
    """Return the number of samples during the rest in which the force is zeroed."""
    fewest, most = REST_SAMPLES
    return min(max(fewest, round(REST_S / period_s)), most)


def residual(model: Model) -> ResidualTable | None:
    """Return the residual of x_1 for the armed program; an arming contains no other residual."""
    return model.residuals[0].table() if len(model.residuals) == 1 else None


def ring_shares(rig: RigFile, assumed: OutputTiming | None = None) -> RingShares:
    """Return the contribution of the mode's ringing to the uncertainty of a position.

    The contributions are 0 for observers that model the mode.

    Parameters
    ----------
    assumed
        Delays of the output, as stated by the drivers, for a model without ``output_delay_s``;
        None: the contributions are 0. Steps in parts cause so little ringing that the usual delay
        is sufficient.
    """
    model, part, period_s = rig.model, rig.part, rig.rig.period_s
    known = model.output_delay_s is not None or rig.shaping_s is not None
    output = model.output(period_s) if known else assumed
    if model.force_observer != "quasi_static" or output is None:
        return RingShares()
    return shares_of_ring(
        model.natural_frequency_rad_per_s,
        model.damping_ratio,
        output._replace(delay_s=output.delay_s + (rig.shaping_s or 0.0)),
        period_s,
        stiffness_ratio=rig.stiffness_ratio,
        stiffness_tolerance=part.stiffness_tolerance,
        shaping_s=rig.shaping_s,
    )


def force_observer(rig: RigFile) -> ForceObserver:
    """Return the observer that a rig file names; raises ConfigError."""
    try:
        return _observer(rig.model, rig.rig.period_s, rig.sensor.noise_um)
    except ValueError as error:
        raise ConfigError(
            f'model.force_observer = "{rig.model.force_observer}": {error}'
        ) from error


def _observer(model: Model, period_s: float, noise_um: float) -> ForceObserver:
    omega_n, zeta = model.natural_frequency_rad_per_s, model.damping_ratio
    s_p = model.compliance_um_per_mN
    if model.force_observer == "inverse_dynamics":
        return inverse_dynamics(
            omega_n, zeta, s_p, period_s=period_s, filter_s=model.inverse_filter_s
        )
    if model.force_observer == "kalman":
        return augmented_kalman(
            omega_n,
            zeta,
            s_p,
            period_s=period_s,
            noise_um=noise_um,
            rate_mN_per_s=model.force_rate_mN_per_s,
        )
    if model.force_observer == "smooth":
        output = model.output(period_s)
        older, lag = held_age(output.delay_s / period_s), kept(period_s, output.lag_s)
        return QuasiStatic(QuasiStaticParameters(s_p, older=older, lag=lag))
    least_s = least_period_s(omega_n)
    if period_s < least_s:
        raise ValueError(
            f"period_s = {period_s} s is below {least_s:.5f} s, two periods of the mode, so "
            'that its ringing would be read as force; choose "smooth", "inverse_dynamics" '
            'or "kalman"'
        )
    printed = model.force_ages == "printed"
    return QuasiStatic(
        QuasiStaticParameters(
            s_p,
            newest_voltage=printed,
            printed_um_per_V=model.piezo_um_per_V if printed else 0.0,
        )
    )


def step_limits(rig: RigFile) -> StepLimits:
    """Return the limits used to detect and classify a step of the position."""
    return StepLimits(rig.sensor.noise_um, rig.model.compliance_um_per_mN, rig.rig.period_s)


def check_way_um(rig: RigFile) -> float:
    """Return the distance in µm over which the program checks whether an arm is free.

    Over ``CHECK_NOISES`` times the sensor noise, noise changes the measured fraction of the free
    motion by one percent.
    """
    return max(CHECK_UM, CHECK_NOISES * rig.sensor.noise_um)


def free_arm(rig: RigFile, way_um: float) -> FreeArm:
    """Return the properties of one arm needed to check over a distance, in µm, whether it is
    free.
    """
    model, part = rig.model, rig.part
    s_p = model.compliance_um_per_mN
    softest = part.stiffness_mN_per_um * (1.0 - part.stiffness_tolerance)
    return FreeArm(
        s_p, 1.0 / (1.0 + s_p * softest), _share_error(model, way_um), rig.sensor.noise_um
    )


def _share_error(model: Model, way_um: float) -> float:
    """Return the relative standard error of the slope of x_1 over a distance.

    If a straight line deviates from a hysteresis loop by the fraction f (r.m.s.), its slope is
    wrong by up to 3·f, the width of the loop; all errors up to that are equally likely.
    """
    taught, recorded = model.free_response, model.recorded_response
    if recorded is not None:
        return sqrt(2.0) * recorded.residual_um / way_um
    if taught is None:
        return sqrt(3.0) * model.hysteresis_fraction
    growth, d_p = taught.growth(), model.piezo_um_per_V
    error_um = sqrt(2.0) * taught.residual_um if growth is None else growth.at(way_um / d_p)
    return hypot(error_um / way_um, turn_error_um_per_V(model) / d_p)


def planned_rig(
    rig: RigFile,
    present_um: float | None = None,
    condition_V: float | None = None,
    rest_um: float | None = None,
) -> PlannedRig:
    """Return a rig in the form for planners.

    Parameters
    ----------
    present_um
        Present position of the arm, in µm; None: at rest. It counts as unknown if the sensor cannot
        measure it.
    condition_V
        Lowest voltage of the strokes with which a plan begins, in V; None: without strokes.
    rest_um
        Reading of the arm at rest at 0 V, in µm; None: unknown.
    """
    limits, model = rig.limits, rig.model
    return PlannedRig(
        limits=PlanLimits(
            voltage_min_V=limits.voltage_min_V,
            voltage_max_V=limits.voltage_max_V,
            position_min_um=limits.position_min_um,
            position_max_um=limits.position_max_um,
            force_max_mN=limits.force_max_mN,
            slew_V_per_s=limits.slew_V_per_s,
            acceleration_um_per_s2=acceleration_limit(model.natural_frequency_rad_per_s),
        ),
        piezo_um_per_V=model.piezo_um_per_V,
        compliance_um_per_mN=model.compliance_um_per_mN,
        period_s=rig.rig.period_s,
        x_start_um=X_START_UM,
        present_um=_readable(rig, present_um),
        rest_um=_readable(rig, rest_um),
        free_response=identified_hysteresis(model),
        taught_V=None if model.free_response is None else model.free_response.taught_V,
        memory=begin_memory(model),
        condition_V=condition_V,
        strokes=_strokes(model),
    )


def _readable(rig: RigFile, x_um: float | None) -> float | None:
    """Return a position, or None if the sensor cannot measure it."""
    sensor = rig.sensor
    if x_um is None or not sensor.minimum_um <= x_um <= sensor.maximum_um:
        return None
    return x_um


def creep_percent_per_decade(model: Model) -> float:
    """Return the creep after a step in % of the step per decade of time."""
    free = model.free_response
    return 0.0 if free is None else free.creep_percent_per_decade


def return_error_um(model: Model) -> float:
    """Return the standard error of x_1 on the return after pressing a part, in µm; 0 if it is
    unknown.
    """
    free = model.free_response
    return 0.0 if free is None or free.return_error_um is None else free.return_error_um


def turn_error_um_per_V(model: Model) -> float:
    """Return the standard error of the slope of x_1 just after a reversal, in µm/V; 0 if it is
    unknown.
    """
    free = model.free_response
    return 0.0 if free is None else free.turn_error_um_per_V or 0.0


def creep_known_s(model: Model) -> float:
    """Return the age of a zero up to which the free response models creep, in s.

    It is ``CREEP_REACH`` times the longest identified creep time, or infinite if there is none.
    """
    free = model.free_response
    if free is None or not free.creep_times_s:
        return inf
    return CREEP_REACH * max(free.creep_times_s)
