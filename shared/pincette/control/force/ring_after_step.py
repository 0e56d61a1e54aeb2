"""Detection of ringing of a pressed arm after a step of its position, which indicates a slip.

When a part slips, the arm is away from its new equilibrium and rings until it has settled. When the
sensor jumps, the arm stays at rest. At constant voltage the samples after the step are

    x_k = x_rest + e^(-d·k·T)·(A·cos(w·k·T) + B·sin(w·k·T)) + noise,
    w = w_n·√(1 + kappa),  d = zeta·w_n,  kappa = s_p·K_e

with any A and B, since the step may occur at any time between two samples. The sum of squares that
the best A and B explain is compared with the sum that noise alone would explain. The absence of
ringing proves nothing: friction may damp a slip.

Units: µm, s, rad/s.
"""

from math import ceil

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]

FREQUENCY_ERROR = 0.02
"""Largest relative error of the frequency of the pressed mode that the search allows for."""
TRIED = 9
"""Number of frequencies that are tried within ``FREQUENCY_ERROR``."""
DECAYS = 4.0
"""Number of decay time constants during which ringing is searched for."""
SAMPLES = (4, 48)
"""Smallest and largest number of samples in which ringing is searched for."""
RESTED = 8
"""Number of samples, following those that are searched for ringing, whose mean is the rest
position."""
SURE = 18.0
"""Smallest ratio of the explained sum of squares to the variance of the noise that counts as
ringing. With two amplitudes and several frequencies, noise alone exceeds it after less than one
step in a thousand."""


def ring_samples(decay_per_s: float, period_s: float) -> int:
    """Return the number of samples after a step that are examined."""
    fewest, most = SAMPLES
    return min(max(fewest, ceil(DECAYS / (decay_per_s * period_s))), most)


def rings(
    x_um: Column, *, mode_rad_per_s: float, decay_per_s: float, period_s: float, noise_um: float
) -> bool | None:
    """Return whether the samples after a step show ringing, or None if there are too few.

    Parameters
    ----------
    x_um
        Positions from the first sample after the step on, at a constant voltage.
    mode_rad_per_s
        Angular frequency of the pressed mode.
    noise_um
        R.m.s. noise of one reading.
    """
    count = ring_samples(decay_per_s, period_s)
    if len(x_um) < count + RESTED or noise_um <= 0.0 or not np.isfinite(x_um).all():
        return None
    rest_um = float(np.mean(x_um[count : count + RESTED]))
    ringing_um = x_um[:count] - rest_um
    t_s = np.arange(count) * period_s
    fall = np.exp(-decay_per_s * t_s)
    explained = 0.0
    for share in np.linspace(-FREQUENCY_ERROR, FREQUENCY_ERROR, TRIED):
        turn = (1.0 + share) * mode_rad_per_s * t_s
        basis = np.column_stack((fall * np.cos(turn), fall * np.sin(turn)))
        fitted = basis @ np.linalg.lstsq(basis, ringing_um, rcond=None)[0]
        explained = max(explained, float(fitted @ fitted))
    # The mean of the rest position is uncertain too.
    return explained > SURE * noise_um**2 * (1.0 + count / RESTED * 0.25)
