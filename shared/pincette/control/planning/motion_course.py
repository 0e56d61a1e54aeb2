"""The predicted course of a motion without a part, or of one that lets a part go.

The arm is taken to follow its voltage by the nominal gain, x - x_0 = d_p·(u - u_0), from where it
stands, but for a part's release, whose end is where the arm rests.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pincette.control.checks import require_positive
from pincette.control.planning.course import Course, PlannedPhase
from pincette.control.planning.profiles import SHORTEST_MOVE_S, quintic
from pincette.control.planning.program import Segment


@dataclass(frozen=True, slots=True)
class Leg:
    """One segment with position and voltage at its end."""

    segment: Segment
    x_um: float
    voltage_V: float

    @property
    def duration_s(self) -> float:
        """As it is drawn."""
        duration_s = self.segment.duration_s
        return SHORTEST_MOVE_S if duration_s is None else duration_s


def planned_phases(legs: Sequence[Leg]) -> tuple[PlannedPhase, ...]:
    """Phases in time; no force is known of."""
    phases: list[PlannedPhase] = []
    start_s = 0.0
    for leg in legs:
        phases.append(
            PlannedPhase(
                leg.segment.phase,
                leg.segment.kind,
                start_s,
                leg.duration_s,
                leg.x_um,
                0.0,
                leg.voltage_V,
                leg.segment.path,
            )
        )
        start_s += leg.duration_s
    return tuple(phases)


def motion_course(
    legs: Sequence[Leg], x_um: float, voltage_V: float, piezo_um_per_V: float, period_s: float
) -> Course:
    """Course of the legs from where the arm stands, every ``period_s`` from 0 to their end.

    Raises
    ------
    ValueError
        Where the gain or the period is not finite and positive.
    """
    d_p = require_positive("piezoelectric constant", piezo_um_per_V, "µm/V")
    require_positive("period", period_s, "s")
    course = Course([], [], [], [], [])
    phases = planned_phases(legs)
    place = 0
    # The last tick may lie a rounding error beyond the end.
    for tick in range(int(phases[-1].end_s / period_s + 1e-6) + 1):
        t_s = tick * period_s
        while place + 1 < len(legs) and t_s >= phases[place + 1].start_s:
            x_um, voltage_V = legs[place].x_um, legs[place].voltage_V
            place += 1
        leg, since_s = legs[place], t_s - phases[place].start_s
        path = leg.segment.path
        if path is None:
            share = quintic(since_s / leg.duration_s)
            x, u = x_um + share * (leg.x_um - x_um), voltage_V + share * (leg.voltage_V - voltage_V)
        else:
            u = path.at(since_s) + (voltage_V if path.relative else 0.0)
            x = x_um + d_p * (u - voltage_V)
        course.t_s.append(t_s)
        course.phase.append(leg.segment.phase)
        course.x_r_um.append(x)
        course.force_r_mN.append(0.0)
        course.voltage_V.append(u)
    return course
