"""Detection of position steps that the voltage does not explain: slips and sensor jumps.

A pressed arm rests where the free arm and the part balance. With the free position x_1 and kappa =
s_p·K_e,

    x = (x_1 + kappa·x_e)/(1 + kappa),    so that    Δx = Δx_1/(1 + kappa)

while the part does not move. If the face of the part recedes by δ at constant voltage, or if the
sensor jumps by J, the position changes by

    slip:    Δx = δ·kappa/(1 + kappa),    ΔF = -K_e·δ/(1 + kappa) = -Δx/s_p
    jump:    Δx = J,                      ΔF = 0, while the estimate changes by -J/s_p

so that a slip can only move the arm forwards. The unexplained step of a sample relative to the mean
of the m samples before is compared with the r.m.s. noise sigma of one reading:

    r = Δx - Δx_1/(1 + kappa),    |r| > 5.5·sigma·√(1 + 1/m) + 0.02 µm + 0.1·|Δx_1|

is an alarm. The last term allows for an error of kappa. While kappa is not known, as in the first
samples of a load, only a step forwards can be detected, with the kappa of the softest possible
part:

    r = Δx - max(0, Δx_1)/(1 + least kappa) > 5.5·sigma·√(1 + 1/m) + 0.02 µm

A force that falls while the position rises is no criterion, because noise moves the two in opposite
directions in almost every load.

While a path is followed, each step of the voltage excites the mode. The contribution of its ringing
to the position is proportional to the speed at the samples before, so that it exceeds the threshold
most where the path turns. The threshold is therefore raised to

    |r| > 5.5·sigma·√(1 + 1/m) + 0.02 µm + 0.1·|Δx_1| + 0.2·max|Δx_1|

with the largest step of the newest samples.

Units: µm, mN, mN/µm, µm/mN, s. Source: equilibrium of the quasi-static arm, (53) of Q. Xu, IEEE
T-ASE 10(3), 2013; thresholds found on simulated arms of three classes, loads of parts with 0.3 to 3
times the planned stiffness, without a false alarm in 400.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import ceil, sqrt
from typing import NamedTuple

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.record import FrozenRecord

SIGMAS = 5.5
"""Threshold in standard deviations: one false alarm in 10^7 samples of normal noise."""
SLACK_UM = 0.02
"""Constant term of the threshold, in µm, for the resolution of the sensor."""
EXPLAINED = 0.1
"""Fraction of a step of the free arm that an error of kappa may leave unexplained."""
RINGING = 0.2
"""Fraction of the fastest step of the free position that the ringing of the mode may leave
unexplained along a path. With noise it was 0.13 at 5 Hz without an output lag, less than 0.09 at 2
Hz, and less than 0.05 with a lag of 3.3 ms, for relay and Bouc-Wen hysteresis."""
SPAN_S = 0.006
"""Time over which a step is measured if the period is shorter, in s. The ringing of the mode and
the lag of the output last this long."""
SHORT_MEAN, REST_MEAN = 3, 8
"""Number of samples in the mean before a step: the first for short periods, the second if enough
samples exist."""
AVERAGED = 8
"""Number of samples after a step over which its size is averaged while the voltage is frozen."""


@dataclass(frozen=True, slots=True)
class StepLimits:
    """Limits by which position steps of a rig are detected.

    Raises
    ------
    ValueError
        If the noise is negative, or compliance or period are not positive.
    """

    noise_um: float
    """R.m.s. noise of one reading, in µm."""
    compliance_um_per_mN: float
    """Compliance s_p of the arm, in µm/mN."""
    period_s: float

    span: int = field(init=False)
    """Number of periods between the samples before a step and the sample that is checked."""
    mean_of: int = field(init=False)
    """Number of samples in the mean relative to which a step is measured."""
    limit_um: float = field(init=False)
    """Threshold term of noise and resolution, in µm, for a mean of ``mean_of`` samples."""
    rest_limit_um: float = field(init=False)
    """Threshold term of noise and resolution, in µm, for a mean of ``REST_MEAN`` samples."""
    resting_um: float = field(init=False)
    """Travel of the free position up to which the longer mean is used, in µm. An error of kappa
    then causes at most a quarter of its threshold."""

    def __post_init__(self) -> None:
        noise_um = require_not_negative("noise", self.noise_um, "µm")
        require_positive("compliance", self.compliance_um_per_mN, "µm/mN")
        span = max(1, ceil(SPAN_S / require_positive("period", self.period_s, "s") - 1e-9))
        mean_of = 1 if span == 1 else SHORT_MEAN
        object.__setattr__(self, "span", span)
        object.__setattr__(self, "mean_of", mean_of)
        for name, count in (("limit_um", mean_of), ("rest_limit_um", REST_MEAN)):
            limit_um = SIGMAS * noise_um * sqrt(1.0 + 1.0 / count) + SLACK_UM
            object.__setattr__(self, name, limit_um)
        object.__setattr__(self, "resting_um", 0.25 * self.rest_limit_um / EXPLAINED)

    def kappa(self, stiffness_mN_per_um: float) -> float:
        """Return s_p·K_e."""
        return self.compliance_um_per_mN * stiffness_mN_per_um

    def with_noise(self, noise_um: float) -> "StepLimits":
        """Return the limits for a sensor whose noise exceeds that in its rig file."""
        return replace(self, noise_um=noise_um) if noise_um > self.noise_um else self


class Kappa(FrozenRecord, frozen=True):
    """Product s_p·K_e for the gripped part."""

    value: float
    known: bool = True
    """False if ``value`` is a lower bound."""

    def explained_um(self, free_um: float) -> float:
        """Return the largest motion of the arm that a step of the free position explains, in µm."""
        return (free_um if self.known else max(0.0, free_um)) / (1.0 + self.value)


class Step(NamedTuple):
    """A step of the position that the voltage does not explain."""

    step_um: float
    """Unexplained part of the step, r, in µm; positive towards the part."""
    before_x_um: float
    """Mean position before the step, in µm."""
    before_free_um: float
    """Mean free position x_1 before the step, in µm."""

    @property
    def forwards(self) -> bool:
        """Return True if a slip can have caused the step."""
        return self.step_um > 0.0


class StepWatch(FrozenRecord, frozen=True):
    """The newest positions and free positions of a pressed arm, oldest first."""

    x_um: tuple[float, ...] = ()
    free_um: tuple[float, ...] = ()

    def updated(self, limits: StepLimits, x_um: float, free_um: float) -> "StepWatch":
        """Return the watch with the newest sample added."""
        kept = limits.span - 1 + max(limits.mean_of, REST_MEAN)
        return StepWatch((*self.x_um[-kept:], x_um), (*self.free_um[-kept:], free_um))

    def step(self, limits: StepLimits, kappa: Kappa, *, along_path: bool = False) -> Step | None:
        """Return the unexplained step of the newest sample, or None if the voltage explains it.

        Along a path the threshold allows for ringing of the mode, in proportion to the largest step
        of the newest samples.
        """
        end = len(self.x_um) - limits.span
        if end < limits.mean_of:
            return None
        begin = end - limits.mean_of
        if along_path:
            ring_um = RINGING * limits.span * self._fastest_um()
            return self._against(begin, end, kappa, limits.limit_um + ring_um)
        found = self._against(begin, end, kappa, limits.limit_um)
        if kappa.known and limits.mean_of < REST_MEAN <= end:
            begin = end - REST_MEAN
            if self._at_rest(begin, limits):
                # Also for a step that the short mean shows, since its size is more exact then.
                return self._against(begin, end, kappa, limits.rest_limit_um) or found
        return found

    def _fastest_um(self) -> float:
        """Return the largest step of the free position from one kept sample to the next, in µm."""
        return max((abs(after - before) for before, after in pairwise(self.free_um)), default=0.0)

    def _at_rest(self, begin: int, limits: StepLimits) -> bool:
        """Return whether the free position has moved by less than the threshold since a sample.

        If the arm moves, a long mean lies several samples back, and an error of kappa acts on the
        travel over all of them.
        """
        way_um = max(self.free_um[begin:]) - min(self.free_um[begin:])
        return way_um <= limits.resting_um

    def _against(self, begin: int, end: int, kappa: Kappa, limit_um: float) -> Step | None:
        """Compare the newest sample with the mean of the samples from ``begin`` up to ``end``."""
        count = end - begin
        before_x_um = sum(self.x_um[begin:end]) / count
        before_free_um = sum(self.free_um[begin:end]) / count
        free_um = self.free_um[-1] - before_free_um
        if kappa.known:
            step_um = self.x_um[-1] - before_x_um - free_um / (1.0 + kappa.value)
            limit_um += EXPLAINED * (free_um if free_um > 0.0 else -free_um)
            beyond = step_um > limit_um or -step_um > limit_um
        else:
            step_um = self.x_um[-1] - before_x_um - kappa.explained_um(free_um)
            beyond = step_um > limit_um
        return Step(step_um, before_x_um, before_free_um) if beyond else None


def unexplained_um(step: Step, x_um: float, free_um: float, kappa: Kappa) -> float:
    """Return the step of a later sample relative to the mean before ``step``, in µm."""
    return x_um - step.before_x_um - kappa.explained_um(free_um - step.before_free_um)


def mean_step_error_um(noise_um: float) -> float:
    """Return the standard error, in µm, that noise causes in the size of a step at rest.

    The step is the difference between the means of ``AVERAGED`` samples after it and ``REST_MEAN``
    samples before it.
    """
    return noise_um * sqrt(1.0 / AVERAGED + 1.0 / REST_MEAN)


def slip_um(step_um: float, kappa: float) -> float:
    """Return the distance δ by which the face of a part receded: r·(1 + 1/κ) for a step r.

    Raises
    ------
    ValueError
        If kappa is not positive.
    """
    return step_um * (1.0 + 1.0 / require_positive("s_p·K_e", kappa, ""))


class RestNoise(FrozenRecord, frozen=True):
    """R.m.s. noise of the sensor, from differences of successive samples at rest.

    Creep shifts successive samples almost equally, so that sigma² = ⟨(x_k - x_(k-1))²⟩/2 does not
    contain it.
    """

    last_um: float | None = None
    """Newest position of the rest, in µm; None between two rests."""
    count: int = 0
    sum_um2: float = 0.0

    def updated(self, x_um: float) -> "RestNoise":
        """Return the noise with one more sample of the rest added."""
        if self.last_um is None:
            return RestNoise(x_um, self.count, self.sum_um2)
        return RestNoise(x_um, self.count + 1, self.sum_um2 + (x_um - self.last_um) ** 2)

    def left(self) -> "RestNoise":
        """Return the noise at the end of a rest."""
        return RestNoise(None, self.count, self.sum_um2)

    @property
    def noise_um(self) -> float:
        """Return the standard deviation of one reading; 0 before the first difference."""
        return sqrt(0.5 * self.sum_um2 / self.count) if self.count else 0.0
