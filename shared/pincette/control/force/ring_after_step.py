"""Detection of the ring of a pressed arm after a step of its position, which a slip causes.

A part that gives way leaves the arm off its new balance, so that the pressed mode rings down from
there; a sensor that jumps leaves the arm at rest. With the voltage kept, the samples after the step
are

    x_k = x_rest + e^(-d·k·T)·(A·cos(w·k·T) + B·sin(w·k·T)) + noise,
    w = w_n·√(1 + kappa),  d = zeta·w_n,  kappa = s_p·K_e

with any A and B, since the step falls anywhere between two samples. The share of the samples'
squares that the best A and B explain is compared with the share that noise alone explains. The
absence of a ring proves nothing: friction may damp a slip.

Units: µm, s, rad/s.
"""

from math import ceil

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]

FREQUENCY_ERROR = 0.02
"""Relative error of the frequency of the pressed mode that the search covers."""
TRIED = 9
"""Number of frequencies that are tried in this range."""
DECAYS = 4.0
"""Number of decay time constants in which a ring is searched."""
SAMPLES = (4, 48)
"""Least and largest number of samples in which a ring is searched."""
RESTED = 8
"""Number of samples after those whose mean is the rest."""
SURE = 18.0
"""Least ratio of the explained squares to the variance of the noise that counts as a ring. With two
amplitudes and the frequencies that are tried, noise alone exceeds it in less than one step of a
thousand."""


def ring_samples(decay_per_s: float, period_s: float) -> int:
    """Return the number of samples after a step that are examined."""
    fewest, most = SAMPLES
    return min(max(fewest, ceil(DECAYS / (decay_per_s * period_s))), most)


def rings(
    x_um: Column, *, mode_rad_per_s: float, decay_per_s: float, period_s: float, noise_um: float
) -> bool | None:
    """Return whether the samples after a step show a ring, or None where there are too few.

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
    # The mean of the rest is uncertain too.
    return explained > SURE * noise_um**2 * (1.0 + count / RESTED * 0.25)
