"""Force observer for short sampling periods. It inverts the mode: (53) with its G⁻¹(s).

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from dataclasses import dataclass
from math import exp, sqrt

from pincette.control.arm.mode import Mode, sample_mode
from pincette.control.checks import require_not_negative, require_positive
from pincette.control.record import FrozenRecord

NOISE_GAIN_MAX = 5.0
"""Largest amplification of the sensor's noise for which the inverse is accepted."""


@dataclass(frozen=True, slots=True)
class InverseParameters:
    """Coefficients of the observer; made by ``inverse_dynamics``."""

    mode: Mode
    gain_mN_per_um: float
    zero_1: float
    """Coefficient 2e^(-σT)cos ω_d T of the inverse."""
    zero_2: float
    """Coefficient e^(-2σT) of the inverse."""
    pole: float
    """Double pole e^(-T/τ) of the filter."""
    noise_gain: float


class InverseDynamics(FrozenRecord, frozen=True):
    """(53) with G(s) of (54) and a filter that makes its inverse proper.

        F̂ = (1/s_p)·G⁻¹(s)/(τs + 1)²·(G·x_1 - x),   G⁻¹ = (s² + 2ζω_n s + ω_n²)/ω_n²     (53)

    ``free_um`` is the x_1 of the voltage without the mode. It is constant over a period, so that
    G·x_1, the printed x_1(t), is computed exactly and the force of a free arm is 0 for any period.
    The inverse is discretised by matched zeros and poles,

        F̂ = (g/s_p)·(1 - 2e^(-σT)cos(ω_d T) z⁻¹ + e^(-2σT) z⁻²)/(1 - e^(-T/τ) z⁻¹)²·(G·x_1 - x)

    where g makes the gain 1 at low frequencies. Its zeros are the poles of the sampled mode, so
    that ringing left in G·x_1 - x vanishes within two samples, whether the mode lies below half the
    sampling rate or is aliased. Tustin's method, even prewarped to ω_n, needs T < π/ω_n and gives a
    wrong damping. The exact inverse for a piecewise constant force has a ringing pole near z = -1.
    The disadvantage of matched zeros and poles is a lag of about one sample plus 2τ.
    """

    parameters: InverseParameters
    mode_um: float = 0.0
    """Output G·x_1 of the mode, in µm."""
    speed_um_per_s: float = 0.0
    """Rate of change of the mode's output, in µm/s."""
    error_1_um: float = 0.0
    """Difference G·x_1 - x of the previous sample, in µm."""
    error_2_um: float = 0.0
    force_1_mN: float = 0.0
    """Force F̂ of the previous sample, in mN."""
    force_2_mN: float = 0.0

    @property
    def noise_gain(self) -> float:
        """Return the noise gain of the inverse with its filter."""
        return self.parameters.noise_gain

    def observe(
        self, x_um: float, free_um: float, _voltage_V: float, /
    ) -> tuple["InverseDynamics", float]:
        """Advance the mode by x_1 and return the force from G·x_1 minus the position."""
        p, mode = self.parameters, self.parameters.mode
        offset_um, speed = self.mode_um - free_um, self.speed_um_per_s
        mode_um = free_um + mode.xx * offset_um + mode.xv * speed
        error_um = mode_um - x_um
        ring_um = error_um - p.zero_1 * self.error_1_um + p.zero_2 * self.error_2_um
        F_mN = p.gain_mN_per_um * ring_um + p.pole * (
            2.0 * self.force_1_mN - p.pole * self.force_2_mN
        )
        after = InverseDynamics(
            p,
            mode_um,
            mode.vx * offset_um + mode.vv * speed,
            error_um,
            self.error_1_um,
            F_mN,
            self.force_1_mN,
        )
        return after, F_mN

    def restart(self, x_um: float, free_um: float, _voltage_V: float, /) -> "InverseDynamics":
        """Return the observer for an arm at rest under a constant force."""
        p, error_um = self.parameters, free_um - x_um
        F_mN = p.gain_mN_per_um * (1.0 - p.zero_1 + p.zero_2) * error_um / (1.0 - p.pole) ** 2
        return InverseDynamics(p, free_um, 0.0, error_um, error_um, F_mN, F_mN)


def inverse_dynamics(
    natural_frequency_rad_per_s: float,
    damping_ratio: float,
    compliance_um_per_mN: float,
    *,
    period_s: float,
    filter_s: float,
) -> InverseDynamics:
    """Return the observer of an arm.

    Parameters
    ----------
    natural_frequency_rad_per_s, damping_ratio
        ω_n and ζ of (54).
    filter_s
        Time constant τ. 0 omits the filter, without which the sampled inverse is realisable too.

    Raises
    ------
    ValueError
        If a value is out of range, or the period is so close to a multiple of the mode's period
        that a sampled oscillation looks like a constant: the inverse would then amplify noise
        without bound.
    """
    mode = sample_mode(natural_frequency_rad_per_s, damping_ratio, period_s)
    s_p = require_positive("compliance", compliance_um_per_mN, "µm/mN")
    tau_s = require_not_negative("inverse filter", filter_s, "s")
    zero_1 = mode.xx + mode.vv
    zero_2 = mode.xx * mode.vv - mode.xv * mode.vx
    pole = exp(-period_s / tau_s) if tau_s > 0.0 else 0.0
    gain = (1.0 - pole) ** 2 / (1.0 - zero_1 + zero_2)
    noise_gain = _noise_gain(gain, zero_1, zero_2, pole)
    if noise_gain > NOISE_GAIN_MAX:
        raise ValueError(
            f"period = {period_s} s: the inverse of the mode would amplify noise {noise_gain:.1f} "
            f"times, limit {NOISE_GAIN_MAX}; choose another period or a longer inverse filter"
        )
    return InverseDynamics(
        InverseParameters(mode, gain / s_p, zero_1, zero_2, pole, noise_gain),
    )


def _noise_gain(gain: float, zero_1: float, zero_2: float, pole: float) -> float:
    """Return the root of the sum of squares of the impulse response."""
    inputs = [1.0, -zero_1, zero_2]
    squares = before = before_2 = 0.0
    # The response falls as k·p^k; its sum after the end is below 1e-12 of the whole.
    for index in range(100_000):
        put_in = inputs[index] if index < len(inputs) else 0.0
        now = gain * put_in + pole * (2.0 * before - pole * before_2)
        squares += now * now
        if index > len(inputs) and now * now + before * before <= 1e-24 * squares:
            break
        before, before_2 = now, before
    return sqrt(squares)
