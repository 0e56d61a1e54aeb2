"""Causes of the error of a path or of a hold: five contributions, each an r.m.s. value.

With the measured position x, the references x_r and F_r, the target x_d of the impedance (10), the
learned correction l of the reference, and the estimate F̂ of every sample,

    x - x_r = d + g,    g = x_d - x_r - l,    d = x - x_d + l

g is the deviation that the impedance commands because F̂ and x do not lie on the contact line of
the references; d is the error of the law itself. d is decomposed further:

    d = τ·ẋ_r + c·ẍ_r + r + n

The first two terms, fitted by least squares, are proportional to speed and acceleration of the
reference: they are the lag. The component of the remainder that repeats in each cycle (in a hold,
the slow component) is the response r that the model of the free arm lacks. In g, the component
proportional to ẋ_r is the lag of the estimate, since no contact line depends on the speed. The rest
of the repeating component of g is attributed to the contact line. The remainders of d and g are
noise. Samples at which a limit acted, and those just after, are attributed to the limits only.

No instrument measures the true force. The causes of its error are

    noise         K_e·√(n² - σ²), the motion of the arm; the sensor's own noise σ moves nothing
    response      u, the standard uncertainty of F̂ that the estimator states
    contact line  the repeating component of F̂ - F_r - K_e·d that is not proportional to ẋ_r
    lag           K_e times the lag of the position

Each cause is an r.m.s. over all N samples, so that the squares can be added. Each repeating cause c
of the position contributes N⁻¹·Σ c·(r + g + lag), at least 0, to the square of their sum: a wrong
estimate makes the impedance and the law deviate by opposite amounts, which is no error.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_not_negative, require_positive

Series = NDArray[np.float64]
Cause = Literal["noise", "response", "contact_line", "lag", "limits"]
CAUSES: tuple[Cause, ...] = ("noise", "response", "contact_line", "lag", "limits")
AFTER_LIMIT = 10
"""Number of samples that count as limited after the last sample in which a limit acted."""
SLOW_TICKS = 25
"""Number of ticks over which slow errors are averaged if the references do not swing."""
LEAST = 10
"""Smallest number of samples that is evaluated."""


@dataclass(frozen=True, slots=True)
class Tracked:
    """N samples of a path at full amplitude or of a hold; each column has length N and no gaps.

    Raises
    ------
    ValueError
        If columns differ in length, there are fewer than ``LEAST`` samples or no whole number of
        cycles, or a constant is impossible.
    """

    x_um: Series
    x_r_um: Series
    x_d_um: Series
    learned_um: Series
    """Correction l that learning adds to the reference, in µm; zero without learning."""
    force_mN: Series
    """Estimated force F̂, in mN."""
    force_r_mN: Series
    standard_uncertainty_mN: Series
    """Standard uncertainty u of F̂ without the sensor's noise, in mN."""
    limited: NDArray[np.bool_]
    """True for samples in which a limit acted."""
    cycle_ticks: int
    """Number of samples in a cycle; 0 if the references do not swing."""
    stiffness_mN_per_um: float
    """Stiffness K_e of the contact line of the references, in mN/µm."""
    noise_um: float
    """R.m.s. noise σ of the sensor, in µm."""

    def __post_init__(self) -> None:
        count = len(self.x_um)
        columns = (
            self.x_r_um,
            self.x_d_um,
            self.learned_um,
            self.force_mN,
            self.force_r_mN,
            self.standard_uncertainty_mN,
            self.limited,
        )
        if count < LEAST or any(len(one) != count for one in columns):
            raise ValueError(
                f"{count} samples: needed are at least {LEAST}, and equally many of each quantity"
            )
        if self.cycle_ticks and count % self.cycle_ticks:
            raise ValueError(
                f"{count} samples are not a whole number of cycles of {self.cycle_ticks}"
            )
        require_positive("contact stiffness K_e", self.stiffness_mN_per_um, "mN/µm")
        require_not_negative("sensor noise", self.noise_um, "µm")


@dataclass(frozen=True, slots=True)
class Sources:
    """R.m.s. contributions to an error, by cause, in µm or mN."""

    total: float
    """Total error: for the position the measured r.m.s., for the force the root of the sum of
    squares of all contributions."""
    by_cause: Mapping[Cause, float]

    @property
    def largest(self) -> Cause:
        """Return the largest cause."""
        return max(CAUSES, key=lambda cause: self.by_cause[cause])


def error_sources(seen: Tracked) -> tuple[Sources, Sources]:
    """Return the position errors in µm and the errors of the true force in mN, by cause."""
    K_e, limited = seen.stiffness_mN_per_um, _spread(seen.limited)
    error_um = seen.x_um - seen.x_r_um
    gives_um = seen.x_d_um - seen.x_r_um - seen.learned_um
    own_um = error_um - gives_um
    free = ~limited
    own_lag_um = _with_speed(own_um, seen.x_r_um, free)
    rest_um = own_um - own_lag_um
    # No contact line depends on the speed, but the error of a delayed estimate does.
    late_um = _with_speed(gives_um, seen.x_r_um, free, derivatives=1)
    gives_um = gives_um - late_um
    lag_um = own_lag_um + late_um
    repeats_um, scatter = _repeating(rest_um, free, seen.cycle_ticks)
    off_um, _ = _repeating(gives_um, free, seen.cycle_ticks)
    # The noise of the estimate moves the target, and the law follows: both contribute.
    noise_um = scatter * _rms(rest_um - repeats_um + gives_um - off_um, free)
    returns_um = repeats_um + off_um + lag_um
    # A mean over few cycles still contains some of the noise.
    shared_um2 = noise_um**2 * (1.0 - scatter**-2.0)
    position: dict[Cause, float] = {
        "noise": noise_um,
        "response": sqrt(max(0.0, _product(repeats_um, returns_um, free) - shared_um2)),
        "contact_line": sqrt(max(0.0, _product(off_um, returns_um, free))),
        "lag": sqrt(max(0.0, _product(lag_um, returns_um, free))),
        "limits": _rms(error_um, limited),
    }
    force_error_mN = seen.force_mN - seen.force_r_mN
    beside_mN = force_error_mN - K_e * own_um
    beside_mN = beside_mN - _with_speed(beside_mN, seen.x_r_um, free, derivatives=1)
    off_line_mN, _ = _repeating(beside_mN, free, seen.cycle_ticks)
    moved_um = sqrt(max(0.0, noise_um**2 - seen.noise_um**2))
    force: dict[Cause, float] = {
        "noise": K_e * moved_um,
        "response": _rms(seen.standard_uncertainty_mN, free),
        "contact_line": _rms(off_line_mN, free),
        "lag": K_e * position["lag"],
        "limits": _rms(force_error_mN, limited),
    }
    every = np.ones(len(error_um), dtype=np.bool_)
    total_mN = sqrt(sum(value * value for value in force.values()))
    return Sources(_rms(error_um, every), position), Sources(total_mN, force)


def _product(one: Series, other: Series, there: NDArray[np.bool_]) -> float:
    """Return the sum of products over selected samples, divided by the number of all samples."""
    return float(one[there] @ other[there]) / len(one)


def _rms(values: Series, there: NDArray[np.bool_]) -> float:
    """Return the root of the sum of squares over selected samples, divided by the number of all
    samples.
    """
    return sqrt(_product(values, values, there))


def _spread(limited: NDArray[np.bool_]) -> NDArray[np.bool_]:
    found = limited.copy()
    for place in np.flatnonzero(limited):
        found[place : place + AFTER_LIMIT + 1] = True
    return found


def _with_speed(
    error: Series, x_r_um: Series, there: NDArray[np.bool_], *, derivatives: int = 2
) -> Series:
    """Return the component of an error proportional to speed and acceleration of the reference."""
    speed = np.gradient(x_r_um)
    moving = np.column_stack((speed, np.gradient(speed))[:derivatives])
    # A derivative of the reference that is almost constant has no such component.
    moving = moving[:, np.ptp(moving, axis=0) > 1e-6]
    if not moving.shape[1] or there.sum() <= moving.shape[1]:
        return np.zeros_like(error)
    factors, *_ = np.linalg.lstsq(moving[there], error[there], rcond=None)
    along: Series = moving @ factors
    return along


def _repeating(error: Series, there: NDArray[np.bool_], cycle_ticks: int) -> tuple[Series, float]:
    """Return the component that repeats in n cycles or is slow, and the factor √(n/(n - 1))."""
    masked = np.where(there, error, np.nan)
    cycles = len(error) // cycle_ticks if cycle_ticks else 0
    if cycles > 1:
        table = masked.reshape(cycles, cycle_ticks)
        known = np.isfinite(table)
        means = np.nansum(table, axis=0) / np.maximum(1, known.sum(axis=0))
        return np.tile(means, cycles), sqrt(cycles / (cycles - 1))
    width = min(SLOW_TICKS, len(error))
    window = np.ones(width)
    count = np.convolve(there.astype(np.float64), window, "same")
    sums = np.convolve(np.where(there, error, 0.0), window, "same")
    return sums / np.maximum(1.0, count), sqrt(width / (width - 1))
