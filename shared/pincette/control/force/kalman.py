"""Force observer that weights the mode against sensor noise: an augmented Kalman filter.

Source: R. E. Kalman, Journal of Basic Engineering 82, 1960, with the force as an additional state,
as in disturbance observers.
"""

from dataclasses import dataclass
from math import sqrt

from pincette.control.arm.mode import Mode, sample_mode
from pincette.control.checks import require_positive
from pincette.control.force.estimation import force
from pincette.control.record import FrozenRecord

Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]
ITERATIONS_MAX = 100_000
CONVERGED = 1e-12
"""Relative change of the gain between iterations below which the recursion ends."""


@dataclass(frozen=True, slots=True)
class KalmanParameters:
    """Mode and steady gain of the filter; made by ``augmented_kalman``."""

    mode: Mode
    compliance_um_per_mN: float
    gain_x: float
    gain_v_per_s: float
    gain_mN_per_um: float
    noise_gain: float


class AugmentedKalman(FrozenRecord, frozen=True):
    """Position, speed and force of the pressed arm, estimated from its position.

        x - q ← e^(AT)(x - q),   q = x_1 - s_p·F        the exact mode, x_1 held
        F ← F + w                                       a random walk, linear within a period
        y = x + v                                       v white, of the sensor's r.m.s.

    F changes linearly from sample to sample and not in a step, as the force of a spring does, so
    that F̂ has the age of x. If the sampling period is much longer than that of the mode, F̂
    becomes (x_1 - x)/s_p minus the remaining ringing.
    """

    parameters: KalmanParameters
    x_um: float = 0.0
    speed_um_per_s: float = 0.0
    force_mN: float = 0.0

    @property
    def noise_gain(self) -> float:
        """Return the standard error of F̂ by the filter's own model, relative to noise/s_p."""
        return self.parameters.noise_gain

    def observe(
        self, x_um: float, free_um: float, _voltage_V: float, /
    ) -> tuple["AugmentedKalman", float]:
        """Return the observer after a sample, and the estimated force in mN.

        The state is predicted with the arm's mode, then corrected with the measured position.
        """
        p, mode = self.parameters, self.parameters.mode
        rest_um = free_um - p.compliance_um_per_mN * self.force_mN
        offset_um, speed = self.x_um - rest_um, self.speed_um_per_s
        predicted_um = rest_um + mode.xx * offset_um + mode.xv * speed
        surprise_um = x_um - predicted_um
        F_mN = self.force_mN + p.gain_mN_per_um * surprise_um
        after = AugmentedKalman(
            p,
            predicted_um + p.gain_x * surprise_um,
            mode.vx * offset_um + mode.vv * speed + p.gain_v_per_s * surprise_um,
            F_mN,
        )
        return after, F_mN

    def restart(self, x_um: float, free_um: float, _voltage_V: float, /) -> "AugmentedKalman":
        """Return the observer for an arm at rest under the force that holds it there."""
        p = self.parameters
        return AugmentedKalman(p, x_um, 0.0, force(x_um, free_um, p.compliance_um_per_mN))


def augmented_kalman(
    natural_frequency_rad_per_s: float,
    damping_ratio: float,
    compliance_um_per_mN: float,
    *,
    period_s: float,
    noise_um: float,
    rate_mN_per_s: float = 50.0,
) -> AugmentedKalman:
    """Return the observer with the gain to which the Riccati recursion converges.

        P⁻ = A P Aᵀ + (rate·T)² g gᵀ,   K = P⁻cᵀ/(c P⁻ cᵀ + noise²),   P = P⁻ - K c P⁻

    It is computed in plain floats, so that the gain is the same to the last bit on every machine.

    Parameters
    ----------
    noise_um
        r.m.s. of the sensor's noise.
    rate_mN_per_s
        The only setting: r.m.s. change of F over a period, divided by the period. A lower rate
        averages longer and lags more. The default is above the 31 mN/s that 20 mN peak to peak
        at 0.5 Hz reach; at T = 1 ms it reduces the effect of 0.03 µm of noise from 0.065 to
        0.036 mN, and lags a ramp by 1.1 ms. At T = 20 ms it hardly averages.

    Raises
    ------
    ValueError
        If a value is out of range, or the rate so low that the recursion does not converge.
    """
    mode = sample_mode(natural_frequency_rad_per_s, damping_ratio, period_s)
    s_p = require_positive("compliance", compliance_um_per_mN, "µm/mN")
    noise = require_positive("sensor noise", noise_um, "µm")
    step_mN = require_positive("force rate", rate_mN_per_s, "mN/s") * period_s
    transition: Matrix = (
        (mode.xx, mode.xv, -s_p * (1.0 - mode.xx)),
        (mode.vx, mode.vv, s_p * mode.vx),
        (0.0, 0.0, 1.0),
    )
    drive: Row = (-s_p * mode.ramp_x * step_mN, -s_p * mode.ramp_v * step_mN, step_mN)
    gain, variance = _steady(transition, drive, noise * noise)
    return AugmentedKalman(
        KalmanParameters(mode, s_p, *gain, noise_gain=sqrt(variance) * s_p / noise),
    )


def _steady(transition: Matrix, drive: Row, noise: float) -> tuple[Row, float]:
    """Return the steady gain, and the variance of F̂ after the correction."""
    covariance: Matrix = ((noise, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, drive[2] * drive[2]))
    gain: Row = (0.0, 0.0, 0.0)
    for _ in range(ITERATIONS_MAX):
        ahead = _predicted(transition, drive, covariance)
        innovation = ahead[0][0] + noise
        before, gain = (
            gain,
            (
                ahead[0][0] / innovation,
                ahead[1][0] / innovation,
                ahead[2][0] / innovation,
            ),
        )
        covariance = _corrected(ahead, gain)
        if all(
            abs(new - old) <= CONVERGED * abs(new) for new, old in zip(gain, before, strict=True)
        ):
            return gain, covariance[2][2]
    raise ValueError(
        f"force rate: {drive[2]} mN a period are too small compared with {sqrt(noise)} µm of "
        f"noise, the gain has not converged in {ITERATIONS_MAX} iterations"
    )


def _predicted(A: Matrix, g: Row, P: Matrix) -> Matrix:
    """Return A P Aᵀ + g gᵀ, made symmetric."""
    AP = [[_dot(row, (P[0][j], P[1][j], P[2][j])) for j in range(3)] for row in A]

    def entry(i: int, j: int) -> float:
        return _dot((AP[i][0], AP[i][1], AP[i][2]), A[j]) + g[i] * g[j]

    xx, vv, FF = entry(0, 0), entry(1, 1), entry(2, 2)
    xv, xF, vF = entry(0, 1), entry(0, 2), entry(1, 2)
    return ((xx, xv, xF), (xv, vv, vF), (xF, vF, FF))


def _corrected(P: Matrix, gain: Row) -> Matrix:
    """Return P - K c P, where c selects the position."""

    def row(i: int) -> Row:
        return (
            P[i][0] - gain[i] * P[0][0],
            P[i][1] - gain[i] * P[0][1],
            P[i][2] - gain[i] * P[0][2],
        )

    return (row(0), row(1), row(2))


def _dot(a: Row, b: Row) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
