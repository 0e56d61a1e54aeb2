"""The force estimator (53), quasi-static and with matched ages, and when it may be zeroed.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013. F > 0 is compressive, the grip on
the object; (53) as printed gives the opposite sign.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log10, sqrt

from pincette.control.free_response import FreeResponse, FreeSample, rest_mean

COVERAGE = 2.0
"""Coverage factor of the uncertainty: about 95 % where the parts are normal."""


def force(x_um: float, free_um: float, compliance_um_per_mN: float) -> float:
    """Contact force in mN from position x_k and the free response x_1 of the voltage of k-1.

        F̂ = -(x - x_1)/s_p                                                               (53)

    G⁻¹ ≈ 1 where the period is long against the resonance's. x_k answers to the voltage applied
    at k-1, hence x_1 is taken from that one. Then the printed term d_p/s_p·[u(t) - u(t - T)]
    is left out: it belongs to an x_1 of another age, and on a moving free arm it reads as force.
    """
    return (free_um - x_um) / compliance_um_per_mN


def smoothing(period_s: float, time_constant_s: float) -> float:
    """Share 1 - e^(-T/τ) by which a first-order low-pass follows each sample; 1 where τ is 0.

    The sensor's noise is amplified by 1/s_p into F̂, and by the law into a to-and-fro of the
    voltage, which wears the hysteresis; a few samples of averaging take most of it away.
    """
    return 1.0 - exp(-period_s / time_constant_s) if time_constant_s > 0.0 else 1.0


def uncertainty(
    *,
    noise_um: float,
    free_error_um: float,
    compliance_um_per_mN: float,
    creep_mN_per_decade: float,
    zero_age_s: float,
    forgotten_mN: float,
) -> float:
    """Expanded uncertainty of the force in mN: root sum of squares, times ``COVERAGE``.

    Its parts, each taken as a standard uncertainty: the sensor's r.m.s. noise and the error of the
    free response since the zero, both over s_p; the creep that x_1 does not know, which grows with
    log10(1 + age/1 s) of the zero; and what the actuator has forgotten and x_1 has not.
    """
    noise_mN = noise_um / compliance_um_per_mN
    free_mN = free_error_um / compliance_um_per_mN
    creep_mN = creep_mN_per_decade * log10(1.0 + max(0.0, zero_age_s))
    return COVERAGE * sqrt(
        noise_mN * noise_mN + free_mN * free_mN + creep_mN * creep_mN + forgotten_mN * forgotten_mN
    )


@dataclass(frozen=True, slots=True)
class ZeroLimits:
    """What a rest must satisfy for the force to be zeroed on it."""

    rest_samples: int = 10
    spread_um: float = 0.5
    """Largest spread, maximum minus minimum, of x and of x - x_1 over the rest."""
    offset_um: float = 5.0
    """Largest change of the offset without travel, and"""
    offset_fraction: float = 0.4
    """the share of d_p·|u - u_zero| by which it may grow: hysteresis and an error of d_p."""


def zero_refusal(
    model: FreeResponse,
    samples: Sequence[FreeSample],
    *,
    part_held: bool,
    limits: ZeroLimits,
) -> str:
    """Why the force must not be zeroed on the end of ``samples``; "" where it may be.

    Refused while a part is held, before there are enough samples, where the arm has not settled,
    and where x_1 would move by more than hysteresis and creep explain.
    """
    if part_held:
        return "zero refused: a part is held, and its force would be taken for none"
    count = limits.rest_samples
    if len(samples) < count:
        return f"zero refused: {len(samples)} samples of rest, {count} are wanted"
    first = len(samples) - count
    lowest_um = highest_um = samples[first].x_um
    lowest_residual_um = highest_residual_um = model.residual_um(samples[first])
    for index in range(first + 1, len(samples)):
        sample = samples[index]
        lowest_um = min(lowest_um, sample.x_um)
        highest_um = max(highest_um, sample.x_um)
        residual_um = model.residual_um(sample)
        lowest_residual_um = min(lowest_residual_um, residual_um)
        highest_residual_um = max(highest_residual_um, residual_um)
    spread_um = max(highest_um - lowest_um, highest_residual_um - lowest_residual_um)
    if not spread_um <= limits.spread_um:
        return (
            f"zero refused: the arm has not settled, it spread over {spread_um:.3f} µm "
            f"in {count} samples, limit {limits.spread_um} µm"
        )
    rest = rest_mean(samples, count)
    change_um = model.residual_um(rest)
    travel_um = model.nominal_um_per_V * abs(rest.voltage_V - model.zero_V)
    limit_um = limits.offset_um + limits.offset_fraction * travel_um
    if not abs(change_um) <= limit_um:
        return (
            f"zero refused: the offset would change by {change_um:.3f} µm, "
            f"limit {limit_um:.3f} µm after {travel_um:.1f} µm of travel"
        )
    return ""
