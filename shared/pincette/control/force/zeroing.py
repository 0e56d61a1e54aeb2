"""Conditions under which the force may be zeroed: only if the arm is known to be free.

Zeroing declares the force of a resting arm to be 0. A zero set in contact would hide the contact
force for as long as it is used, so any doubt is a reason to refuse it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt
from statistics import NormalDist

from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.force.contact_detector import DetectedContact
from pincette.control.response.free_response import FreeResponse, FreeSample, rest_mean

NOISE_REFUSES = 1e-6
"""Largest fraction of settled rests that may be refused because of noise alone."""


@dataclass(frozen=True, slots=True)
class ZeroLimits:
    """Conditions that a rest must meet before the force is zeroed."""

    rest_samples: int = 10
    spread_um: float = 0.5
    """Largest spread (maximum minus minimum) of x and of x - x_1 during the rest, without noise, in
    µm."""
    noise_um: float = 0.0
    """Standard deviation of the sensor's noise, in µm."""
    offset_um: float = 5.0
    """Largest change of the offset without travel if the history of the arm is unknown, in µm."""
    offset_fraction: float = 0.4
    """Fraction of d_p·|u - u_zero| by which the offset may change. It allows for the whole
    hysteresis and an error of d_p."""
    first_touch_um: float = inf
    """Smallest position at which the arm may be in contact with the part, in µm."""
    touch_um: float = inf
    """Distance by which a contact may have pushed the arm back: the contact force times s_p, in
    µm."""

    def settled_um(self) -> float:
        """Return the largest spread of a settled rest, in µm.

        Noise alone spreads over r·σ or more with a probability of at most n(n-1)·Φ(-r/√2), where n
        is the number of samples. The limit includes r·σ for the r at which this probability is
        ``NOISE_REFUSES``.
        """
        pairs = self.rest_samples * (self.rest_samples - 1)
        if not pairs or not self.noise_um:
            return self.spread_um
        r = -sqrt(2.0) * NormalDist().inv_cdf(NOISE_REFUSES / pairs)
        return max(self.spread_um, r * self.noise_um)

    def change_um(self, model: FreeResponse, creep_um: float, memory_known: bool) -> float:
        """Return how far a zero at the last voltage may move the offset of x_1, in µm.

        Parameters
        ----------
        model
            Free response with the present zero.
        creep_um
            Distance by which creep and an unknown history may have moved the arm since that zero.
        memory_known
            True if the model has followed the arm beyond this voltage before. Otherwise the model
            may lack hysteresis from before it was started, and its own tolerance would refuse the
            zero of a free arm.
        """
        limit_um = model.zero_tolerance_um(creep_um)
        if memory_known:
            return limit_um
        travel_um = model.nominal_um_per_V * abs(model.voltage_V - model.zero_V)
        return max(limit_um, self.offset_um + self.offset_fraction * travel_um + creep_um)


def zero_refusal(
    model: FreeResponse,
    samples: Sequence[FreeSample],
    *,
    part_held: bool,
    limits: ZeroLimits,
    creep_um: float = 0.0,
    touch: DetectedContact | None = None,
    zeroed: bool = True,
    kept: bool = False,
    memory_known: bool = True,
) -> Fault | None:
    """Return the reason why the force must not be zeroed at the end of ``samples``, or None.

    The zero is refused while a part is held, before there are enough samples, if the arm has not
    settled, if it is beyond the planned first contact, if a contact was detected and has pushed the
    arm back since, and if x_1 would change by more than hysteresis, model error and creep explain.

    Parameters
    ----------
    samples
        Oldest first, with the voltages and positions up to the present.
    creep_um
        Distance by which creep may have moved the arm since the last zero.
    touch
        Contact detected since the last zero.
    zeroed
        True if the force was zeroed since the arming. Otherwise the offset is compared with the
        position in which the arm was found, and the refusal has a separate code.
    kept
        True if the zero in use is from an earlier arming. In that case an arm beyond its zero
        position is no reason to refuse: no part in front of it can pull it forwards, so a part that
        pressed it at that zero is gone.
    memory_known
        As for ``ZeroLimits.change_um``.
    """
    if part_held:
        return fault(FaultCode.ZERO_PART_HELD)
    count = limits.rest_samples
    if len(samples) < count:
        return fault(FaultCode.ZERO_TOO_FEW_SAMPLES, samples=len(samples), wanted_samples=count)
    spread_um, settled_um = _spread_um(model, samples, count), limits.settled_um()
    if not spread_um <= settled_um:
        return fault(
            FaultCode.ZERO_NOT_SETTLED,
            spread_um=spread_um,
            samples=count,
            limit_um=settled_um,
            noise_um=limits.noise_um,
        )
    rest = rest_mean(samples, count)
    if not rest.x_um <= limits.first_touch_um:
        return fault(
            FaultCode.ZERO_BEYOND_FIRST_TOUCH, x_um=rest.x_um, limit_um=limits.first_touch_um
        )
    if touch is not None:
        back_um = touch.pushed_back_um(rest.x_um, model.nominal_um_per_V * rest.voltage_V)
        if back_um > limits.touch_um:
            return fault(
                FaultCode.ZERO_TOUCHED,
                touch_x_um=touch.x_um,
                back_um=back_um,
                limit_um=limits.touch_um,
            )
    travel_um = model.nominal_um_per_V * abs(rest.voltage_V - model.zero_V)
    change_um = model.residual_um(rest)
    limit_um = limits.change_um(model, creep_um, memory_known)
    ahead = kept and change_um > 0.0
    if not (ahead or abs(change_um) <= limit_um):
        return fault(
            FaultCode.ZERO_OFFSET if zeroed else FaultCode.ZERO_FIRST_OFFSET,
            change_um=change_um,
            limit_um=limit_um,
            travel_um=travel_um,
        )
    return None


def _spread_um(model: FreeResponse, samples: Sequence[FreeSample], count: int) -> float:
    """Return the larger spread of x and of x - x_1 over the last ``count`` samples."""
    first = len(samples) - count
    lowest_um = highest_um = samples[first].x_um
    lowest_residual_um = highest_residual_um = model.residual_um(samples[first])
    for index in range(first + 1, len(samples)):
        sample = samples[index]
        lowest_um = min(lowest_um, sample.x_um)
        highest_um = max(highest_um, sample.x_um)
        residual_um = model.residual_um(sample)
        lowest_residual_um = min(lowest_residual_um, residual_um)
        highest_residual_um = max(highest_residual_um, residual_um)
    return max(highest_um - lowest_um, highest_residual_um - lowest_residual_um)
