"""How far the estimated force may be off, as the estimator stands."""

from math import hypot, log10, sqrt

from pincette.control.force.estimation import COVERAGE, late_creep_um, uncertainty
from pincette.control.response.free_response import MemoryResponse, rest_mean
from pincette.control.response.residual_table import Residual
from pincette.control.response.reversal_memory import forgotten_share
from pincette.control.response.unknown_past import UnknownPast, standard_uncertainty_um
from pincette_estimator.config import EstimatorConfig
from pincette_estimator.state import Followed, Ringing, State


def uncertainty_mN(
    config: EstimatorConfig,
    memories: State | Followed,
    missed: Residual | None,
    zero_s: float | None,
    seq: int,
) -> float:
    """Uncertainty of the force at a sample, by the memories led up to it.

    A residual table has what x_1 misses of hysteresis, reversals and creep along the very motion;
    what is left of them is its error. Past the end of what was played creep begins anew.
    """
    t_s = seq * config.period_s
    age_s = t_s if zero_s is None else t_s - zero_s
    # Any drift up to the largest is equally likely.
    drift_um = config.drift_um_per_s * max(0.0, age_s) / sqrt(3.0)
    free_um = memories.response.error_um()
    share = forgotten_share(memories.reversal_memory.total_V, config.forgotten_scale_V)
    lost_mN = share * config.forgotten_mN
    if config.residual is not None and missed is not None and zero_s is not None:
        free_um, lost_mN = config.residual.error_um, 0.0
        age_s = missed.beyond * config.period_s
    response = memories.response
    late_um = late_creep_um(
        percent_per_decade=config.creep_percent_per_decade,
        stroke_um=response.nominal_um_per_V * response.voltage_V,
        age_s=0.0 if zero_s is None else t_s - zero_s,
        known_to_s=config.creep_known_s,
    )
    unknown_um = standard_uncertainty_um(memories.unknown.error_um(memories.response))
    ring = ring_um(config, memories.ringing)
    return uncertainty(
        noise_um=config.noise_um,
        free_error_um=hypot(free_um, unknown_um, drift_um, late_um, ring),
        compliance_um_per_mN=config.compliance_um_per_mN,
        creep_mN_per_decade=config.creep_mN_per_decade,
        zero_age_s=age_s,
        forgotten_mN=lost_mN,
    )


def ring_um(config: EstimatorConfig, ringing: Ringing) -> float:
    """Return the standard uncertainty of the position by the ring after steps of the voltage."""
    share, _ = config.ring_shares
    return share * ringing.free_um * (config.pressed_share if ringing.part_held else 1.0)


def creep_um(config: EstimatorConfig, age_s: float) -> float:
    """Return how far creep and drift may have moved the reading since a zero of this age, in µm.

    Creep counts at two standard errors, drift at its largest.
    """
    age_s = max(0.0, age_s)
    creep_mN = config.creep_mN_per_decade * log10(1.0 + age_s)
    drift_um = config.drift_um_per_s * age_s
    return COVERAGE * creep_mN * config.compliance_um_per_mN + drift_um


def rested_past(config: EstimatorConfig, state: State) -> UnknownPast:
    """What a free arm at rest tells of its creep since another rest.

    Between them there may have been strokes over the whole range, so that x_1 errs by what the
    model leaves there, at either.
    """
    response, count = state.response, config.zero_limits.rest_samples
    if not isinstance(response, MemoryResponse):
        return state.unknown
    rest = rest_mean(state.free_motion.samples, count)
    standard_um = sqrt(2.0) * response.model_error_um
    return state.unknown.rested(response, rest, standard_um)


def narrowed_past(config: EstimatorConfig, state: State, t_s: float) -> UnknownPast:
    """What a free arm has told of its past since the last zero; nothing before the first."""
    if state.zero_s is None:
        return state.unknown
    response, count = state.response, config.zero_limits.rest_samples
    standard_um = hypot(
        response.error_um(), creep_um(config, t_s - state.zero_s) / COVERAGE, config.noise_um
    )
    residual_um = response.residual_um(rest_mean(state.free_motion.samples, count))
    return state.unknown.compared(response, residual_um, standard_um)
