"""Uncertainty U of the estimated force, from the state of the estimator."""

from math import hypot, inf, log10, sqrt

from pincette.control.force.estimation import COVERAGE, late_creep_um, uncertainty
from pincette.control.response.conditioned_branch import FRESH_V, past_creep_mN
from pincette.control.response.error_growth import TURN_V, ShownError
from pincette.control.response.free_response import FreeResponse, MemoryResponse, rest_mean
from pincette.control.response.identified_response import IdentifiedResponse
from pincette.control.response.reversal_memory import forgotten_share
from pincette.control.response.stroke_check import SIGMAS
from pincette.control.response.unknown_past import (
    ROOT_3,
    UnknownPast,
    standard_uncertainty_um,
)
from pincette_estimator.config import ArmConfig
from pincette_estimator.state import ArmState, Ringing


def uncertainty_mN(config: ArmConfig, state: ArmState, seq: int) -> float:
    """Return the uncertainty of the force at a sample, in mN, from memories updated up to that
    sample.

    A residual table contains the errors of x_1 from hysteresis, reversals and creep in the same
    motion, so that only the error of the table remains. After the recorded motion, creep counts
    from the end of that motion.
    """
    t_s, zero_s = seq * config.period_s, state.zero_s
    missed, response = state.missed, state.response
    age_s = t_s if zero_s is None else t_s - zero_s
    # All drifts up to the largest are equally likely.
    drift_um = config.drift_um_per_s * max(0.0, age_s) / ROOT_3
    free_um, shown = _free_error(config, response)
    share = forgotten_share(state.reversal_memory.total_V, config.forgotten_scale_V)
    lost_mN = share * config.forgotten_mN
    if config.residual is not None and missed is not None and zero_s is not None:
        free_um, lost_mN = config.residual.error_um, 0.0
        shown = ShownError(free_um)
        age_s = missed.beyond * config.period_s
    late_um = late_creep_um(
        percent_per_decade=config.creep_percent_per_decade,
        stroke_um=response.nominal_um_per_V * response.voltage_V,
        age_s=0.0 if zero_s is None else t_s - zero_s,
        known_to_s=config.creep_known_s,
    )
    unknown_um = standard_uncertainty_um(state.unknown.error_um(response))
    ring = ring_um(config, state.ringing)
    past_um, stroke_um = past_creep_um(config, response), uncorrected_um(state)
    return uncertainty(
        noise_um=config.noise_um,
        free_error_um=hypot(free_um, unknown_um, drift_um, late_um, ring, past_um, stroke_um),
        compliance_um_per_mN=config.compliance_um_per_mN,
        creep_mN_per_decade=config.creep_mN_per_decade,
        # Up to the age ``creep_known_s`` the error found in the rehearsals includes creep.
        zero_age_s=(age_s - shown.until_s) / (1.0 + shown.until_s),
        forgotten_mN=lost_mN,
        few_um=shown.error_um,
        rehearsals=shown.rehearsals,
    )


def ring_um(config: ArmConfig, ringing: Ringing) -> float:
    """Return the standard uncertainty of x_1, in µm, from oscillation after steps of the
    voltage."""
    shares = config.ring_shares
    return ringing.free_um * (shares.pressed if ringing.part_held else shares.free)


def _free_error(config: ArmConfig, response: FreeResponse) -> tuple[float, ShownError]:
    """Return the standard error of x_1 since the zero, in µm, and its component from rehearsals.

        E² = E(reach)² + a·[E_return² - E(reach)²] + (1 - a)·(s·fall)²

    The error over the distance since a zero was measured during rising motion, the error of the
    motion back at the position of the zero. In between its square grows with the distance moved
    back, as it does during rising motion: a rises from 0 at a fall of ``FRESH_V`` to 1 at that
    position. A smaller fall, for example due to creep in a hold, does not count as a motion back;
    its error is that of the slope s of x_1 just after a reversal, which was measured up to
    ``TURN_V``.
    """
    if not isinstance(response, IdentifiedResponse):
        error_um = response.error_um()
        return error_um, ShownError(error_um)
    reach_V, shown = response.reach_V, response.rehearsed()
    error_um = shown.error_um
    fell_V = max(0.0, reach_V - (response.voltage_V - response.zero_V))
    share = 0.0
    if fell_V > FRESH_V:
        share = 1.0 if fell_V >= reach_V else (fell_V - FRESH_V) / (reach_V - FRESH_V)
    turn_um = config.turn_error_um_per_V * min(fell_V, TURN_V)
    return_um2 = max(config.return_error_um, error_um) ** 2
    rehearsed_um = sqrt(error_um**2 + share * (return_um2 - error_um**2))
    free_um = hypot(rehearsed_um, sqrt(1.0 - share) * turn_um)
    return free_um, shown._replace(error_um=rehearsed_um)


def past_creep_um(config: ArmConfig, response: FreeResponse) -> float:
    """Return the standard uncertainty, in µm, from creep that began before the strokes."""
    if not isinstance(response, IdentifiedResponse) or not response.strokes.conditioned:
        return 0.0
    creep_mN = past_creep_mN(response.strokes.since_s) / COVERAGE
    return creep_mN * config.compliance_um_per_mN


def uncorrected_um(state: ArmState) -> float:
    """Return the standard uncertainty of x_1, in µm, that a change of the stroke adds if it is
    within its limit and thus not corrected.

    The change was measured over the last conditioned motion. The standard uncertainty of this
    measurement is the limit divided by ``SIGMAS``. Noise may have caused the change, so the error
    is between 0 and the sum of both, in proportion to the motion since the zero.
    """
    stroke, response = state.stroke, state.response
    if stroke is None or not stroke.rested or not isinstance(response, IdentifiedResponse):
        return 0.0
    way_um = response.nominal_um_per_V * (response.voltage_V - response.zero_V)
    unseen = hypot(stroke.change - response.factor + 1.0, stroke.limit / SIGMAS)
    return unseen * abs(way_um) / ROOT_3


def stroke_uncertainty_mN(response: FreeResponse, F_mN: float) -> float:
    """Return the standard uncertainty, in mN, from a changed stroke: |g|·F/√3.

    The free response is corrected for the change. If a changed sensor is the cause, the force still
    has an error of g·F. Position and voltage cannot distinguish a changed sensor from a changed
    actuator.
    """
    if not isinstance(response, IdentifiedResponse) or response.factor == 1.0:
        return 0.0
    return abs(response.factor - 1.0) * abs(F_mN) / ROOT_3


def creep_um(config: ArmConfig, age_s: float, most_drift_um: float = inf) -> float:
    """Return how far creep and drift may have moved the reading since a zero of this age, in µm.

    Creep is taken at two standard errors, drift at its largest value, up to ``most_drift_um``.
    """
    age_s = max(0.0, age_s)
    creep_mN = config.creep_mN_per_decade * log10(1.0 + age_s)
    drift_um = min(config.drift_um_per_s * age_s, most_drift_um)
    return COVERAGE * creep_mN * config.compliance_um_per_mN + drift_um


def rested_past(config: ArmConfig, state: ArmState) -> UnknownPast:
    """Return the history narrowed by the creep of a free arm between two rests.

    Between the two rests there may have been strokes over the whole range, so that x_1 has the
    residual error of the model at both rests.
    """
    response, count = state.response, config.zero_limits.rest_samples
    if not isinstance(response, MemoryResponse):
        return state.unknown
    rest = rest_mean(state.free_motion.samples, count)
    standard_um = sqrt(2.0) * response.model_error_um
    return state.unknown.rested(response, rest, standard_um)


def narrowed_past(config: ArmConfig, state: ArmState, t_s: float) -> UnknownPast:
    """Return the history narrowed by the motion of a free arm since the last zero.

    It is unchanged before the first zero.
    """
    if state.zero_s is None or not config.approach_tells:
        return state.unknown
    response, count = state.response, config.zero_limits.rest_samples
    standard_um = hypot(
        response.error_um(), creep_um(config, t_s - state.zero_s) / COVERAGE, config.noise_um
    )
    residual_um = response.residual_um(rest_mean(state.free_motion.samples, count))
    return state.unknown.compared(response, residual_um, standard_um)
