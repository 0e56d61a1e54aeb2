"""Feasibility of a planned course: every limit that it exceeds, by how much, where and when.

The course is sampled at the control period. The rate of the voltage is its change from one period
to the next. The acceleration of x_r is its second difference. It is limited so that the mode rings
by less than ``RING_UM`` even if the acceleration begins suddenly: a < RING_UM·ω_n².
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pincette.control.checks import require_positive
from pincette.control.planning.prediction import Course
from pincette.control.vocabulary import LimitedQuantity

RING_UM = 0.025
"""Permitted amplitude of the ringing, in µm: the resolution of the paper's sensor."""


@dataclass(frozen=True, slots=True)
class PlanLimits:
    """Limits of a rig that plans must keep."""

    voltage_min_V: float
    voltage_max_V: float
    position_min_um: float
    position_max_um: float
    force_max_mN: float
    slew_V_per_s: float
    acceleration_um_per_s2: float
    """Limit of the acceleration of x_r; see ``acceleration_limit``."""


@dataclass(frozen=True, slots=True)
class Excursion:
    """An interval of one phase in which a course exceeds one limit."""

    quantity: LimitedQuantity
    value: float
    """Value that exceeds the limit most."""
    limit: float
    unit: str
    at_s: float
    """Time at which the excursion begins, in s."""
    phase: str
    """Phase in which the excursion begins."""
    times: int = 1
    """Number of separate intervals in which the course exceeds the limit."""


@dataclass(frozen=True, slots=True)
class Violation:
    """An exceeded limit: the request member, the excess, and where it begins."""

    pointer: str
    """JSON pointer into the request; "" if the cause is not in the request."""
    quantity: LimitedQuantity
    value: float
    limit: float
    unit: str
    at_s: float
    message: str

    @property
    def side(self) -> str:
        """Return the side of the limit on which the value lies: above or below."""
        return "above" if self.value > self.limit else "below"


def acceleration_limit(natural_frequency_rad_per_s: float) -> float:
    """Return the acceleration of x_r in µm/s² that causes ringing of ``RING_UM``: RING_UM·ω_n²."""
    omega_n = require_positive("natural frequency", natural_frequency_rad_per_s, "rad/s")
    return RING_UM * omega_n * omega_n


def excursions(course: Course, limits: PlanLimits) -> tuple[Excursion, ...]:
    """Return an excursion for every phase of a course that exceeds a limit, by limit and time."""
    voltage, position, t_s = course.voltage_V, course.x_r_um, course.t_s
    period_s = t_s[1] - t_s[0] if len(t_s) > 1 else 1.0
    slew = _differences(voltage, period_s)
    acceleration = _differences(_differences(position, period_s), period_s)
    return (
        *_beyond(course, "force", "mN", course.force_r_mN, limits.force_max_mN, 1.0),
        *_beyond(course, "voltage", "V", voltage, limits.voltage_max_V, 1.0),
        *_beyond(course, "voltage", "V", voltage, limits.voltage_min_V, -1.0),
        *_beyond(course, "position", "µm", position, limits.position_max_um, 1.0),
        *_beyond(course, "position", "µm", position, limits.position_min_um, -1.0),
        *_beyond(course, "slew", "V/s", slew, limits.slew_V_per_s, 1.0),
        *_beyond(course, "slew", "V/s", slew, -limits.slew_V_per_s, -1.0),
        *_beyond(course, "acceleration", "µm/s²", acceleration, limits.acceleration_um_per_s2, 1.0),
        *_beyond(
            course, "acceleration", "µm/s²", acceleration, -limits.acceleration_um_per_s2, -1.0
        ),
    )


def beyond(
    course: Course,
    quantity: LimitedQuantity,
    unit: str,
    values: list[float],
    range_: tuple[float, float],
) -> tuple[Excursion, ...]:
    """Return an excursion for every phase in which values leave a range, those above it first."""
    low, high = range_
    return (
        *_beyond(course, quantity, unit, values, high, 1.0),
        *_beyond(course, quantity, unit, values, low, -1.0),
    )


def named_violation(excursion: Excursion, pointer: str) -> Violation:
    """Return an excursion as a violation in words, with the responsible request member."""
    side = "above" if excursion.value > excursion.limit else "below"
    again = "" if excursion.times == 1 else f", {excursion.times} times"
    return Violation(
        pointer=pointer,
        quantity=excursion.quantity,
        value=excursion.value,
        limit=excursion.limit,
        unit=excursion.unit,
        at_s=excursion.at_s,
        message=(
            f"{excursion.quantity} {excursion.value:.3f} {excursion.unit} {side} the limit "
            f"{excursion.limit:g} {excursion.unit}, from {excursion.at_s:.2f} s "
            f"({excursion.phase}{again})"
        ),
    )


def _differences(values: Sequence[float], period_s: float) -> list[float]:
    """Return the rate from each value to the next; the result has as many values as the input."""
    rates = [0.0]
    for index in range(1, len(values)):
        rates.append((values[index] - values[index - 1]) / period_s)
    return rates


def _beyond(
    course: Course,
    quantity: LimitedQuantity,
    unit: str,
    values: list[float],
    limit: float,
    side: float,
) -> list[Excursion]:
    """Return excursions above (side +1) or below (side -1) a limit, one for each phase."""
    found: list[Excursion] = []
    begin: int | None = None
    for index in range(len(values) + 1):
        # A value at the limit is permitted, with a tolerance for rounding.
        outside = index < len(values) and side * (values[index] - limit) > 1e-9
        if outside and begin is None:
            begin = index
        elif not outside and begin is not None:
            furthest = max(values[begin:index], key=lambda value: side * value)
            at_s, phase, times = course.t_s[begin], course.phase[begin], 1
            if found and found[-1].phase == phase:
                before = found.pop()
                at_s, times = before.at_s, before.times + 1
                furthest = max(before.value, furthest, key=lambda value: side * value)
            found.append(Excursion(quantity, furthest, limit, unit, at_s, phase, times))
            begin = None
    return found
