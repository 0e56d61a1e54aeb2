"""Which force serves a law as F_k, in flat records: that of ``law.step``, for what is compiled."""

from typing import NamedTuple


class Fed(NamedTuple):
    """``Law.force_share`` without its absence."""

    planned: bool
    """Whether F_k is what the plan makes of the newest estimate; else the estimate as it is."""
    share: float


def fed(force_share: float | None) -> Fed:
    """From a law's share."""
    return Fed(force_share is not None, force_share or 0.0)


def fed_force(
    k: Fed, force_mN: float, force_r_mN: float, before_r_mN: float, before_error_mN: float
) -> tuple[float, float]:
    """F_k and F - F_r low-passed, in mN.

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
