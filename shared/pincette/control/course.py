"""The predicted course of a plan: positions, forces and voltages in time, and limits broken.

The prediction is linear. At ``x_start_um`` the voltage is 0, and

    u = (x - x_start + s_p·F)/d_p,  in contact F = K_e·(x - x_e)
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pincette.control.checks import require_positive
from pincette.control.profiles import quintic
from pincette.control.program import SegmentKind


@dataclass(frozen=True, slots=True)
class PlannedArm:
    """The arm and what it meets, as a plan assumes them."""

    x_start_um: float
    """Where the arm rests at zero voltage."""
    piezo_um_per_V: float
    """d_p."""
    compliance_um_per_mN: float
    """s_p."""
    contact_um: float
    """x_e, the position of first touch."""
    stiffness_mN_per_um: float
    """K_e."""

    def pressed_um(self, force_mN: float) -> float:
        """Position x = x_e + F/K_e at which the contact bears a force."""
        return self.contact_um + force_mN / self.stiffness_mN_per_um

    def voltage_V(self, x_um: float, force_mN: float) -> float:
        """Voltage that holds a position against a force."""
        travel_um = x_um - self.x_start_um + self.compliance_um_per_mN * force_mN
        return travel_um / self.piezo_um_per_V


@dataclass(frozen=True, slots=True)
class PlannedPhase:
    """One segment as it should go; position, force and voltage are those at its end."""

    phase: str
    kind: SegmentKind
    start_s: float
    duration_s: float
    x_um: float
    force_mN: float
    voltage_V: float


@dataclass(frozen=True, slots=True)
class Course:
    """A predicted course on a regular grid; lists of one length.

    While the arm seeks, ``force_r_mN`` is the force expected of the contact.
    """

    t_s: list[float]
    phase: list[str]
    x_r_um: list[float]
    force_r_mN: list[float]
    voltage_V: list[float]


@dataclass(frozen=True, slots=True)
class PlanLimits:
    """What the rig bears."""

    voltage_min_V: float
    voltage_max_V: float
    position_min_um: float
    position_max_um: float
    force_max_mN: float


@dataclass(frozen=True, slots=True)
class Excursion:
    """One stretch of a course beyond one limit."""

    quantity: str
    value: float
    """The furthest value of the stretch."""
    limit: float
    unit: str
    at_s: float
    """Where the stretch begins, and"""
    phase: str
    """in which phase."""


def sample_course(arm: PlannedArm, phases: Sequence[PlannedPhase], period_s: float) -> Course:
    """Course of the phases every ``period_s``, from 0 to their end.

    Raises
    ------
    ValueError
        Where the period is not finite and positive.
    """
    require_positive("period", period_s, "s")
    course = Course([], [], [], [], [])
    duration_s = phases[-1].start_s + phases[-1].duration_s
    place, x_from_um, force_from_mN = 0, arm.x_start_um, 0.0
    # The last tick may lie a rounding error beyond the end.
    for tick in range(int(duration_s / period_s + 1e-6) + 1):
        t_s = tick * period_s
        phase = phases[place]
        while place + 1 < len(phases) and t_s >= phases[place + 1].start_s:
            x_from_um, force_from_mN = phase.x_um, phase.force_mN
            place += 1
            phase = phases[place]
        share = min(1.0, (t_s - phase.start_s) / phase.duration_s)
        x_um, force_mN = _point(arm, phase, share, x_from_um, force_from_mN)
        course.t_s.append(t_s)
        course.phase.append(phase.phase)
        course.x_r_um.append(x_um)
        course.force_r_mN.append(force_mN)
        course.voltage_V.append(arm.voltage_V(x_um, force_mN))
    return course


def _point(
    arm: PlannedArm, phase: PlannedPhase, share: float, x_from_um: float, force_from_mN: float
) -> tuple[float, float]:
    """Position and force at a share of a phase's time."""
    if phase.kind == "force":
        force_mN = force_from_mN + (phase.force_mN - force_from_mN) * quintic(share)
        return arm.pressed_um(force_mN), force_mN
    if phase.kind == "seek":
        x_um = x_from_um + (phase.x_um - x_from_um) * share
        return x_um, max(0.0, arm.stiffness_mN_per_um * (x_um - arm.contact_um))
    return x_from_um + (phase.x_um - x_from_um) * quintic(share), 0.0


def excursions(course: Course, limits: PlanLimits) -> tuple[Excursion, ...]:
    """Every stretch of a course beyond every limit, ordered by limit and time."""
    voltage, position = course.voltage_V, course.x_r_um
    return (
        *_beyond(course, "force", "mN", course.force_r_mN, limits.force_max_mN, 1.0),
        *_beyond(course, "voltage", "V", voltage, limits.voltage_max_V, 1.0),
        *_beyond(course, "voltage", "V", voltage, limits.voltage_min_V, -1.0),
        *_beyond(course, "position", "µm", position, limits.position_max_um, 1.0),
        *_beyond(course, "position", "µm", position, limits.position_min_um, -1.0),
    )


def _beyond(
    course: Course, quantity: str, unit: str, values: list[float], limit: float, side: float
) -> list[Excursion]:
    """Stretches above (side +1) or below (side -1) a limit."""
    found: list[Excursion] = []
    begin: int | None = None
    for index in range(len(values) + 1):
        # What touches the limit is within it, rounding included.
        outside = index < len(values) and side * (values[index] - limit) > 1e-9
        if outside and begin is None:
            begin = index
        elif not outside and begin is not None:
            furthest = max(values[begin:index], key=lambda value: side * value)
            at_s, phase = course.t_s[begin], course.phase[begin]
            found.append(Excursion(quantity, furthest, limit, unit, at_s, phase))
            begin = None
    return found
