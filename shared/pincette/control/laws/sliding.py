"""What both sliding mode laws share: boundary layer, band, frozen integral, and their output."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LawOutput:
    """The voltage for tick k, and how the law sees the arm.

    Lengths are PBSMIC's own; DSMIFC, whose sliding function is a force, gives them over K̄.
    """

    voltage_V: float
    """u_k, before any limit."""
    x_d_um: float
    """Where the impedance asks the arm to be at k: (16), in DSMIFC with x in place of x_d."""
    error_um: float
    """e_{k-1} = x_{k-1} - x_{d,k-1}; DSMIFC: ε_{k-1}/K̄ (33)."""
    integral_um: float
    """ε_{k-1} (19); DSMIFC: ζ_{k-1}/K̄ (35)."""
    sliding_um: float
    """s_{k-1} (18); DSMIFC: s_{k-1}/K̄ (34)."""
    band_um: float
    """Half width of the band outside which |s| cannot have grown; see ``sliding_band``."""
    residual_um: float
    """x_{k-1} as measured, minus what (17) predicted for the voltage applied."""
    perturbation_mN: float
    """p̂_k = p_{k-1} (6), with the law's own F."""
    perturbation_error_mN: float
    """p̃_{k-1} = p_{k-2} - p_{k-1} (8), with the law's own F: -k̄ times the residual."""


def saturation(s: float, delta: float) -> float:
    """Saturation that takes the place of sgn(s) in (25) and (42).

        sat(s) = sgn(s) where |s| > δ,  s/δ where |s| ≤ δ                                (32)

    ``s`` and ``delta`` are in the unit of the sliding function; δ > 0. The result is in [-1, 1].
    """
    if s > delta:
        return 1.0
    if s < -delta:
        return -1.0
    return s / delta


def sliding_band(per_mN: float, K_S_mN: float, perturbation_error_mN: float) -> float:
    """Half width of the band outside which a step of the law does not let |s| grow.

    With a the factor of p̃ in (28) or (45), s_k = s_{k-1} - a(K_S sgn(s_{k-1}) + p̃_k), so that

        |s_k| ≤ |s_{k-1}|  where  |s_{k-1}| ≥ a (K_S + |p̃_k|)/2  and  K_S ≥ |p̃_k|

    which the paper's (31) and (48) state without the band. ``per_mN`` is a, the result is in the
    unit of s.
    """
    return 0.5 * per_mN * (K_S_mN + abs(perturbation_error_mN))


def winds_up(limited: int, error: float) -> bool:
    """Whether an integral of ``error`` would push the voltage further against a limit.

    ``limited`` is +1 where the voltage may not rise, -1 where it may not fall, else 0. A position
    below its target, a negative error, asks for more voltage.
    """
    return limited * error < 0.0
