"""Exact motion of the arm between samples, for a voltage that changes once within a period.

    ẍ + 2ζω_n·ẋ + ω_n²(1 + K_e s_p)·x = ω_n² d_p·y                                      (54), (1)

in deviations from the equilibrium on a linear contact F = K_e·x. The voltage y at the arm is the
output's u, or u filtered by a first-order lag.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pincette.control.arm.plant import ArmParameters
from pincette.control.checks import require_not_negative, require_positive

Array = npt.NDArray[np.float64]
ORDER = 14
"""Order of the Taylor series of the exponential. Its error is below rounding if the scaled norm is
at most 1/4."""


@dataclass(frozen=True, slots=True)
class LoopCase:
    """Conditions of a loop: the real arm, its contact, and when a voltage takes effect."""

    K_e_mN_per_um: float = 0.0
    """Stiffness of the contact, in mN/µm; 0 for the free arm."""
    frequency_factor: float = 1.0
    """Natural frequency of the real arm divided by the identified one."""
    delay_periods: float = 0.0
    """Delay from the sample to the change of the voltage, as a fraction of the period, 0 to 1."""
    gain_factor: float = 1.0
    """Coefficient d_p of the real arm divided by the identified one."""
    damping_factor: float = 1.0
    """Damping ratio of the real arm divided by the identified one."""
    assumed_mN_per_um: float | None = None
    """Contact stiffness that the law assumes, in mN/µm; 0 for no contact, None for the true one."""

    @property
    def assumed_stiffness(self) -> float:
        """Return the contact stiffness that the law assumes, in mN/µm."""
        assumed_stiffness = self.assumed_mN_per_um
        return self.K_e_mN_per_um if assumed_stiffness is None else assumed_stiffness

    def __post_init__(self) -> None:
        require_not_negative("contact stiffness K_e", self.K_e_mN_per_um, "mN/µm")
        require_positive("frequency factor", self.frequency_factor, "")
        require_positive("gain factor", self.gain_factor, "")
        require_positive("damping factor", self.damping_factor, "")
        require_not_negative("stated contact stiffness", self.assumed_stiffness, "mN/µm")
        if not 0.0 <= self.delay_periods <= 1.0:
            raise ValueError(f"delay = {self.delay_periods} periods, must be within 0 and 1")


def sampled_arms(
    arm: ArmParameters, period_s: float, output_lag_s: float, cases: tuple[LoopCase, ...]
) -> tuple[Array, Array]:
    """Return the transition over one period of every case, and the effect of its voltage.

    The state is (x in µm, ẋ/ω_n in µm, y in V, u_{k-1} in V). The old voltage acts for the delay,
    the new one for the rest of the period.

    Parameters
    ----------
    arm
        The arm as identified, whose properties a case changes.
    output_lag_s
        Time constant between output and arm.

    Returns
    -------
    transition, drive
        Shapes (cases, 4, 4) and (cases, 4).
    """
    omega_n = (arm.k / arm.m) ** 0.5
    omega = omega_n * np.array([case.frequency_factor for case in cases])
    stiffening = 1.0 + np.array([case.K_e_mN_per_um for case in cases]) / arm.k
    gain = arm.d / arm.k * np.array([case.gain_factor for case in cases])
    delay_s = period_s * np.array([case.delay_periods for case in cases])
    rate = np.zeros((len(cases), 4, 4))
    rate[:, 0, 1] = omega
    rate[:, 1, 0] = -omega * stiffening
    # With constant ζ, b/m = 2ζω_n grows with ω_n.
    damping = np.array([case.damping_factor for case in cases])
    rate[:, 1, 1] = -arm.b / arm.m / omega_n * omega * damping
    rate[:, 1, 2 if output_lag_s > 0.0 else 3] = omega * gain
    if output_lag_s > 0.0:
        rate[:, 2, 2], rate[:, 2, 3] = -1.0 / output_lag_s, 1.0 / output_lag_s
    before = exponential(rate * delay_s[:, None, None])
    after = exponential(rate * (period_s - delay_s)[:, None, None])
    transition = np.zeros_like(rate)
    transition[:, :3] = after[:, :3, :3] @ before[:, :3]
    drive = np.ones((len(cases), 4))
    drive[:, :3] = after[:, :3, 3]
    return transition, drive


def exponential(matrices: Array) -> Array:
    """Return matrix exponentials, shape (…, n, n), by scaling and squaring of the Taylor series."""
    norm = float(np.max(np.sum(np.abs(matrices), axis=-1)))
    halvings = max(0, int(np.ceil(np.log2(norm))) + 2) if norm > 0.0 else 0
    small = matrices / 2.0**halvings
    found = term = np.broadcast_to(np.eye(matrices.shape[-1]), matrices.shape)
    for order in range(1, ORDER + 1):
        term = term @ small / order
        found = found + term
    for _ in range(halvings):
        found = found @ found
    return found
