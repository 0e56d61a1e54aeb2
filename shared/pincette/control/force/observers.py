"""Interface of the observers that estimate the contact force from the position.

An observer is immutable and linear: its force and its next state are linear in its inputs and in
its own state. Its field ``parameters`` is fixed; every other field is a float of its state, which
``state_of`` and ``with_state`` read and replace.
"""

from dataclasses import dataclass
from math import exp, pi, sqrt
from typing import Any, Protocol, Self, TypeVar

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.force.estimation import force
from pincette.control.record import FrozenRecord, field_names, replace

SHORTEST_PERIODS = 2.0
"""Shortest sampling period that counts as long, in periods of the mode."""


class ForceObserver(Protocol):
    """Observer that estimates F from x_k and x_1 once per period; F > 0 is compressive."""

    @property
    def noise_gain(self) -> float:
        """Return the noise gain: the standard deviation of s_p·F̂ over that of white noise in x."""
        ...

    def observe(self, x_um: float, free_um: float, voltage_V: float, /) -> tuple[Self, float]:
        """Return the observer updated by x_k, x_1 and u_{k-1}, and its force F̂ in mN.

        ``free_um`` is x_1 without the mode: the position at which the free arm would rest under
        u_{k-1}.
        """
        ...

    def restart(self, x_um: float, free_um: float, voltage_V: float, /) -> Self:
        """Return the observer for an arm at rest at ``x_um``, under the force (x_1 - x)/s_p."""
        ...


AnyObserver = TypeVar("AnyObserver", bound=ForceObserver)


def state_of(observer: ForceObserver) -> tuple[float, ...]:
    """Return the observer's state, without its parameters."""
    return tuple(getattr(observer, name) for name in _names(observer))


def with_state(observer: AnyObserver, state: tuple[float, ...]) -> AnyObserver:
    """Return the observer with another state; raises ValueError if its length is wrong."""
    return replace(observer, **dict(zip(_names(observer), state, strict=True)))


def _names(observer: Any) -> list[str]:
    return [name for name in field_names(observer) or () if name != "parameters"]


def least_period_s(natural_frequency_rad_per_s: float) -> float:
    """Return the shortest period in s for which G⁻¹ ≈ 1 may be assumed: two periods of the mode."""
    omega_n = require_positive("natural frequency", natural_frequency_rad_per_s, "rad/s")
    return SHORTEST_PERIODS * 2.0 * pi / omega_n


def held_age(delay_periods: float) -> float:
    """Return φ, the age difference in periods between x_k and x_1 of the voltage of k-1.

    A voltage that is applied δ periods after its sample and held for one period acts on average at
    time δ + 1/2 if the mode is slow compared with the period and averages the steps; x_k is
    measured at time 1. Hence φ = δ - 1/2, limited to between 0 and 1.
    """
    return min(1.0, max(0.0, delay_periods - 0.5))


def kept(period_s: float, lag_s: float) -> float:
    """Return e^(-T/τ), the fraction of its state that a first-order lag retains over a period.

    It is 0 without a lag.
    """
    return exp(-period_s / lag_s) if lag_s > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class QuasiStaticParameters:
    """Parameters with which ``QuasiStatic`` evaluates (53).

    Raises
    ------
    ValueError
        If s_p is not positive, d_p negative, or ``share`` not within (0, 1].
    """

    compliance_um_per_mN: float
    """Compliance s_p of the arm, in µm/mN."""
    share: float = 1.0
    """Weight of each new reading in the low-pass of the force; 1 without a low-pass. See
    ``smoothing``."""
    newest_voltage: bool = False
    """True if x_k is paired with x_1 of the voltage output at k; False for the voltage applied at
    k-1."""
    printed_um_per_V: float = 0.0
    """Coefficient d_p of the printed term, in µm/V; 0 omits the term."""
    older: float = 0.0
    """Weight of the previous x_1 in the x_1 that is paired with x_k; see ``held_age``."""
    lag: float = 0.0
    """Factor e^(-T/τ) of a first-order lag between output and arm, which is applied to x_1; 0: no
    lag."""

    def __post_init__(self) -> None:
        require_positive("compliance", self.compliance_um_per_mN, "µm/mN")
        require_not_negative("printed piezoelectric constant", self.printed_um_per_V, "µm/V")
        if not 0.0 < self.share <= 1.0:
            raise ValueError(f"share of the low-pass = {self.share}, must be within (0, 1]")
        if not 0.0 <= self.older <= 1.0:
            raise ValueError(f"share of the x_1 before = {self.older}, must be within 0 and 1")
        if not 0.0 <= self.lag < 1.0:
            raise ValueError(f"share that a lag keeps = {self.lag}, must be within [0, 1)")

    @property
    def bare(self) -> bool:
        """Return True if the force does not depend on an earlier sample."""
        plain = self.share == 1.0 and self.older == 0.0 and self.lag == 0.0
        return plain and not self.newest_voltage and self.printed_um_per_V == 0.0


class QuasiStatic(FrozenRecord, frozen=True):
    """Observer (53) with G⁻¹ ≈ 1, for sampling periods much longer than that of the mode.

        F̂ = (x_1 - x)/s_p  [+ d_p/s_p·(u(t) - u(t - T))]                                 (53)

    with signs such that F > 0 is compressive. With matched ages x_k is paired with x_1 of u_{k-1},
    the voltage to which x_k responds. As printed, x, x_1 and u belong to one instant t, but x_1(t)
    follows from a voltage that is output only after x(t) was measured. x must then be delayed by
    one sample, since x_1 of u_k is known at k+1, and a moving free arm gives the false force
    d_p/s_p·[u(t) - u(t - T)]. The printed term has the sign that doubles it; it would cancel the
    false force if x_1 were one sample older than x.
    """

    parameters: QuasiStaticParameters
    force_mN: float = 0.0
    """Force F̂ of the previous sample, in mN."""
    x_um: float = 0.0
    """Position x_{k-1} of the previous sample, in µm."""
    voltage_V: float = 0.0
    """Voltage u_{k-2} of the previous sample, in V."""
    free_um: float = 0.0
    """Free response x_1 of the previous sample, in µm."""
    lagging_um: float = 0.0
    """Lagged free response x_1 of the previous sample, in µm."""

    @property
    def noise_gain(self) -> float:
        """Return √(share/(2 - share)), the noise gain of the low-pass."""
        share = self.parameters.share
        return sqrt(share / (2.0 - share))

    def observe(
        self, x_um: float, free_um: float, voltage_V: float, /
    ) -> tuple["QuasiStatic", float]:
        """Return the low-pass filtered force (53)."""
        p = self.parameters
        if p.bare:
            return self, force(x_um, free_um, p.compliance_um_per_mN)
        x = self.x_um if p.newest_voltage else x_um
        printed_um = p.printed_um_per_V * (voltage_V - self.voltage_V)
        held_um = free_um + p.older * (self.free_um - free_um)
        paired_um = (1.0 - p.lag) * held_um + p.lag * self.lagging_um
        reading_mN = force(x - printed_um, paired_um, p.compliance_um_per_mN)
        F_mN = self.force_mN + p.share * (reading_mN - self.force_mN)
        return QuasiStatic(p, F_mN, x_um, voltage_V, free_um, paired_um), F_mN

    def restart(self, x_um: float, free_um: float, voltage_V: float, /) -> "QuasiStatic":
        """Return the observer for an arm at rest."""
        p = self.parameters
        if p.bare:
            return self
        F_mN = force(x_um, free_um, p.compliance_um_per_mN)
        return QuasiStatic(p, F_mN, x_um, voltage_V, free_um, free_um)
