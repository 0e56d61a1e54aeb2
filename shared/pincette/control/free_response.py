"""The free response x_1: where the voltage alone would put the arm.

A straight line through the last zero, with the slope of the branch of the hysteresis loop on
which the arm arrived there. The line errs as the branch bends and as the arm creeps, and grows
wrong where the voltage reverses; ``force.uncertainty`` carries that.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from pincette.control.checks import require_positive


class FreeSample(NamedTuple):
    """A position of the arm free of contact, and the voltage that led to it (of k-1, for x_k)."""

    voltage_V: float
    x_um: float


@dataclass(frozen=True, slots=True)
class FreeResponse:
    """x_1 = offset + gain·(u - u_zero)."""

    offset_um: float
    gain_um_per_V: float
    zero_V: float
    nominal_um_per_V: float
    """d_p: the gain where none could be measured, and what a measured one is judged by."""


def nominal_response(piezo_um_per_V: float, at: FreeSample) -> FreeResponse:
    """Line of slope d_p through one sample; raises ValueError unless d_p is positive."""
    d_p = require_positive("piezoelectric constant", piezo_um_per_V, "µm/V")
    return FreeResponse(at.x_um, d_p, at.voltage_V, d_p)


def free_position(model: FreeResponse, voltage_V: float) -> float:
    """Displacement x_1 in µm that the voltage alone would give."""
    return model.offset_um + model.gain_um_per_V * (voltage_V - model.zero_V)


def rest_mean(samples: Sequence[FreeSample], rest_samples: int) -> FreeSample:
    """Mean voltage and position of the last ``rest_samples``."""
    voltage_V = x_um = 0.0
    for index in range(len(samples) - rest_samples, len(samples)):
        voltage_V += samples[index].voltage_V
        x_um += samples[index].x_um
    return FreeSample(voltage_V / rest_samples, x_um / rest_samples)


def relinearize(
    model: FreeResponse,
    samples: Sequence[FreeSample],
    *,
    rest_samples: int,
    min_travel_V: float = 0.1,
    gain_tolerance: float = 0.4,
) -> FreeResponse:
    """Put the line through the rest that ends ``samples``, with the gain of the last branch.

    Parameters
    ----------
    samples
        Oldest first; the last ``rest_samples`` of them at rest, all free of contact.
    min_travel_V
        Lever of the slope. It is drawn from the rest to the mean of those samples of the last
        branch that lie between one and two ``min_travel_V`` away.
    gain_tolerance
        A slope that differs from d_p by more than this share of it, or that could not be
        measured, gives way to d_p.

    Raises
    ------
    ValueError
        Where there are fewer than ``rest_samples``.
    """
    if not 1 <= rest_samples <= len(samples):
        raise ValueError(f"{len(samples)} samples, where a rest of {rest_samples} is wanted")
    rest = rest_mean(samples, rest_samples)
    gain = _branch_gain(samples, len(samples) - rest_samples, rest, min_travel_V)
    nominal = model.nominal_um_per_V
    if gain is None or abs(gain - nominal) > gain_tolerance * nominal:
        gain = nominal
    return FreeResponse(rest.x_um, gain, rest.voltage_V, nominal)


def _branch_gain(
    samples: Sequence[FreeSample], end: int, rest: FreeSample, min_travel_V: float
) -> float | None:
    """Slope in µm/V over the branch that leads to the rest; None where it is too short."""
    furthest_V = voltage_V = x_um = 0.0
    count = 0
    for index in range(end - 1, -1, -1):
        sample = samples[index]
        travel_V = abs(sample.voltage_V - rest.voltage_V)
        furthest_V = max(furthest_V, travel_V)
        # Back in time the travel grows until the voltage turned round; a fifth is for its noise.
        if travel_V > 2.0 * min_travel_V or travel_V < furthest_V - 0.2 * min_travel_V:
            break
        if travel_V >= min_travel_V:
            voltage_V += sample.voltage_V
            x_um += sample.x_um
            count += 1
    if count == 0:
        return None
    return (rest.x_um - x_um / count) / (rest.voltage_V - voltage_V / count)
