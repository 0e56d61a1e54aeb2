"""Logarithmic creep as a ladder of first-order lags a decade apart; pure."""

import math
from functools import lru_cache

from pincette.sim.plant.state import CreepStates

CREEP_TIMES_S = (0.1, 1.0, 10.0, 100.0, 1000.0)


@lru_cache(maxsize=64)
def creep_gains(dt_s: float) -> CreepStates:
    """1 - exp(-dt/τ_i): by how much each lag approaches a constant input."""
    g0, g1, g2, g3, g4 = (-math.expm1(-dt_s / time_s) for time_s in CREEP_TIMES_S)
    return g0, g1, g2, g3, g4
