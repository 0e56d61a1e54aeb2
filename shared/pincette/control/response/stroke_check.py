"""Comparison of the stroke of a conditioned arm with its calibration.

Two motions are compared. The first one leads from the lowest voltage of the last conditioning
stroke to the rest after the strokes. It is short and most affected by earlier creep, so that it
shows only large changes. The second one, from this rest to the position of the next zero, repeats
to 0.13 % if the stroke of the arm has not changed. A gain change of the sensor or amplifier and a
change of temperature affect both motions; position and voltage alone do not show which of them
occurred. A change is attributed to measurement error up to

    3·sqrt(s^2 + (4·sigma^2/n + c^2)/L^2) + (drift + p)/L,    s = 0.13 %, or what was calibrated

with the noise sigma of a sample, the number n of samples in the shorter rest, the length L of the
motion in um, the standard uncertainty c of creep from before the strokes, and the largest drift of
the sensor during the motion. The creep of an unknown history may differ from the model's by up to
p, which is included for the motion from the lowest voltage. If the limit exceeds
``LARGEST_CHANGE``, nothing is compared.
"""

from math import hypot, sqrt
from typing import NamedTuple

from pincette.control.record import FrozenRecord
from pincette.control.response.free_response import FreeSample
from pincette.control.response.identified_response import IdentifiedResponse

REPEATS = 0.0013
"""Smallest standard deviation of the ratio of two conditioned motions, without noise."""
SIGMAS = 3.0
SETTLE_SAMPLES = 3
"""Number of samples that are omitted at the start of the rest at the lowest voltage, since the arm
still moves."""
LEAST_WAY_UM = 2.0
"""Shortest motion from the lowest voltage that is compared, in µm."""
LEAST_RISE_UM = 10.0
"""Shortest motion from the rest after the strokes that is compared, in µm."""
LARGEST_CHANGE = 0.05
"""Largest relative change of the stroke with which the force may still be zeroed."""


REST_V = 0.1
"""Largest absolute voltage, in V, of the rest that ended the calibrated motion from the lowest
voltage."""


class Base(FrozenRecord, frozen=True):
    """Position of a conditioned arm at which a motion begins: mean values over a rest."""

    x_um: float
    calibrated_um: float
    """Displacement of the model with the stroke of the calibration, in µm."""
    samples: int
    since_s: float
    """Time from the lowest voltage of the last stroke to this rest, in s."""
    rested: bool = True
    """True for the rest after the strokes; False for the rest at the lowest voltage of the last
    stroke."""


class Bottom(FrozenRecord, frozen=True):
    """Mean values over the rest at the lowest voltage of the last conditioning stroke."""

    seen: int = 0
    """Number of samples at the lowest voltage, including the omitted ones."""
    voltage_V: float = 0.0
    x_um: float = 0.0
    calibrated_um: float = 0.0
    """Displacement of the model with the stroke of the calibration, in µm."""
    apart_um: tuple[float, float] = (0.0, 0.0)
    """Displacement for each of the two extreme histories minus that of the model, at the newest
    sample, in µm; see ``unknown_past``."""

    @property
    def samples(self) -> int:
        """Return the number of samples in the mean values."""
        return max(0, self.seen - SETTLE_SAMPLES)

    @property
    def base(self) -> Base:
        """Return the rest at the lowest voltage as the start of a motion."""
        return Base(self.x_um, self.calibrated_um, self.samples, 0.0, rested=False)

    def updated(
        self,
        response: IdentifiedResponse,
        x_um: float,
        apart_um: tuple[float, float] = (0.0, 0.0),
    ) -> "Bottom":
        """Add a sample of the free arm."""
        strokes = response.strokes
        if not strokes.conditioned:
            return self if self.seen == 0 else Bottom()
        if not strokes.bottom:
            return self
        if not self.seen or response.voltage_V < self.voltage_V:
            return Bottom(1, response.voltage_V)
        if response.voltage_V > self.voltage_V:  # The arm moves up again.
            return self
        seen = self.seen + 1
        count = seen - SETTLE_SAMPLES
        if count <= 0:
            return Bottom(seen, self.voltage_V)
        share = 1.0 / count
        return Bottom(
            seen,
            self.voltage_V,
            self.x_um + share * (x_um - self.x_um),
            self.calibrated_um + share * (response.calibrated_um() - self.calibrated_um),
            apart_um,
        )


class MeasurementErrors(NamedTuple):
    """Measurement errors of a motion, other than a change of the stroke."""

    noise_um: float
    """Standard deviation of one sample, in µm."""
    drift_um_per_s: float = 0.0
    """Largest drift of the sensor, in µm/s."""
    past_um: float = 0.0
    """Standard uncertainty from creep that began before the strokes, in µm."""
    unknown_um: float = 0.0
    """Largest difference between the creep for an unknown history and that of the model, since the
    lowest voltage, in µm."""


class StrokeChange(FrozenRecord, frozen=True):
    """Change of the stroke since the calibration, measured over a conditioned motion."""

    change: float
    """Relative change of the stroke: its factor minus 1."""
    limit: float
    """Largest absolute change that noise and limited repeatability may cause."""
    way_um: float = 0.0
    """Length of the same motion during the calibration, in µm."""
    rested: bool = True
    """True if the motion starts at the rest after the strokes; False if it starts at the lowest
    voltage."""

    @property
    def significant(self) -> bool:
        """Return whether the change exceeds what noise and limited repeatability may cause."""
        return abs(self.change) > self.limit

    @property
    def refused(self) -> bool:
        """Return whether the change is so large that no force may be reported."""
        return self.significant and abs(self.change) > LARGEST_CHANGE


def rest_base(response: IdentifiedResponse, rest: FreeSample, samples: int) -> Base | None:
    """Return a rest as the start of a motion; None if the arm is not on the rising branch."""
    if response.branch is None or not response.strokes.fresh:
        return None
    calibrated_um = rest.displacement_um / response.factor
    return Base(rest.x_um, calibrated_um, samples, response.strokes.since_s)


def stroke_change(
    response: IdentifiedResponse,
    base: Base,
    rest: FreeSample,
    samples: int,
    doubt: MeasurementErrors,
) -> StrokeChange | None:
    """Compare the motion from a base to a rest with that of the calibration.

    Returns None if the arm is not on the rising branch after strokes, the motion is too short, or
    its limit exceeds ``LARGEST_CHANGE``.

    Parameters
    ----------
    rest
        Mean values of the rest, evaluated with this response.
    samples
        Number of samples over which the mean values of the rest were computed.
    """
    branch = response.branch
    if branch is None or not response.strokes.fresh or not base.samples:
        return None
    ratio, spread = branch.rest_ratio, branch.rest_spread
    if base.rested:
        ratio, spread = branch.way_at(rest.voltage_V)
    elif abs(rest.voltage_V) > REST_V:
        return None
    way_um = ratio * (rest.displacement_um / response.factor - base.calibrated_um)
    length_um = abs(way_um)
    if length_um < (LEAST_RISE_UM if base.rested else LEAST_WAY_UM):
        return None
    noise_um = 2.0 * doubt.noise_um / sqrt(min(samples, base.samples))
    random = hypot(max(REPEATS, spread), noise_um / length_um, doubt.past_um / length_um)
    bias_um = doubt.drift_um_per_s * max(0.0, response.strokes.since_s - base.since_s)
    if not base.rested:
        bias_um += doubt.unknown_um
    limit = SIGMAS * random + bias_um / length_um
    if limit > LARGEST_CHANGE:
        return None
    change = (rest.x_um - base.x_um) / way_um - 1.0
    return StrokeChange(change, limit, length_um, base.rested)


def corrected(response: IdentifiedResponse, found: StrokeChange) -> IdentifiedResponse:
    """Return the response with the stroke measured over a conditioned motion.

    An earlier measured stroke is kept if the new measurement agrees with it.
    """
    if abs(found.change - (response.factor - 1.0)) <= found.limit:
        return response
    return response.with_factor(1.0 + found.change if found.significant else 1.0)
