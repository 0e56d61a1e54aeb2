"""Selection of the force that a law uses as F_k."""

from typing import NamedTuple


class ForceInput(NamedTuple):
    """Rule for computing F_k from the newest estimate."""

    planned: bool
    """True if the planned change of F_r extrapolates the estimate to sample k; False if the
    estimate is used unchanged."""
    share: float
    """Weight of each new estimate in the low-pass of F - F_r, if the estimate is extrapolated."""


def input_force(
    k: ForceInput, force_mN: float, force_r_mN: float, before_r_mN: float, before_error_mN: float
) -> tuple[float, float]:
    """Return F_k and the low-passed F - F_r, in mN.

    The estimate F̂ belongs to the newest sample, k-1, while F_{r,k} belongs to k. If F̂ is used
    unchanged, the change of F_r during one period appears as an error to the law. If the estimate
    is extrapolated,

        F_k = F_{r,k} + δ_k,  δ_k = δ_{k-1} + share·(F̂ - F_{r,k-1} - δ_{k-1})

    so that the low-pass removes the noise from the error and does not delay the force itself.

    Parameters
    ----------
    before_r_mN, before_error_mN
        F_{r,k-1}, and the low-passed F - F_r of the last tick.
    """
    error_mN = force_mN - before_r_mN
    if k.planned:
        error_mN = before_error_mN + k.share * (error_mN - before_error_mN)
        force_mN = force_r_mN + error_mN
    return force_mN, error_mN
