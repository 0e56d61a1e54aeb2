"""Selection of the force that a law uses as F_k."""

from typing import NamedTuple


class ForceInput(NamedTuple):
    """Rule by which F_k is made from the newest estimate."""

    planned: bool
    """True if the planned change of F_r carries the estimate on to sample k; else it is used as it
    is."""
    share: float
    """Share by which F - F_r follows each estimate, where the estimate is carried on."""


def input_force(
    k: ForceInput, force_mN: float, force_r_mN: float, before_r_mN: float, before_error_mN: float
) -> tuple[float, float]:
    """Return F_k and the low-passed F - F_r, in mN.

    The estimate F̂ belongs to the newest sample, that is to k-1, while F_{r,k} holds for k. If F̂
    is used unchanged, the law sees a moving F_r as an error of one period. If it is carried on, F_k
    is

        F_k = F_{r,k} + δ_k,  δ_k = δ_{k-1} + share·(F̂ - F_{r,k-1} - δ_{k-1})

    so that the low-pass removes the noise from the error and does not delay the force itself.

    Parameters
    ----------
    before_r_mN, before_error_mN
        F_{r,k-1}, and F - F_r low-passed as the last tick left it.
    """
    error_mN = force_mN - before_r_mN
    if k.planned:
        error_mN = before_error_mN + k.share * (error_mN - before_error_mN)
        force_mN = force_r_mN + error_mN
    return force_mN, error_mN
