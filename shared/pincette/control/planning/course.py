"""The predicted course of a plan: positions, forces and voltages in time, and limits broken.

Where plan and rig agree the arm is where its references are. The voltage is that which brings the
free displacement x - x_start + s_p·F: by the identified free response where there is one, else

    u = (x - x_start + s_p·F)/d_p,  in contact F = K_e·(x - x_e)

At ``x_start_um`` the voltage is 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import fsum

from pincette.control.checks import require_positive
from pincette.control.planning.paths import Path
from pincette.control.planning.profiles import move, quintic, run_up
from pincette.control.planning.program import SegmentKind
from pincette.control.response.hysteresis import HysteresisModel, HysteresisState
from pincette.control.response.inverse import free_voltages

LONGEST_S = 10_800.0
"""What takes longer is not planned: an hour's hold or path, a warm-up, and room for the rest."""


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
    free_response: HysteresisModel | None = None
    memory: HysteresisState | None = None
    """Of the free response as the plan begins; None: the arm is unpoled."""

    def pressed_um(self, force_mN: float) -> float:
        """Position x = x_e + F/K_e at which the contact bears a force."""
        return self.contact_um + force_mN / self.stiffness_mN_per_um

    def voltages_V(
        self, x_um: Sequence[float], force_mN: Sequence[float], period_s: float
    ) -> list[float]:
        """Voltages that lead the arm along positions against forces, a period each."""
        free_um = [
            x - self.x_start_um + self.compliance_um_per_mN * force
            for x, force in zip(x_um, force_mN, strict=True)
        ]
        if self.free_response is None:
            return [displacement / self.piezo_um_per_V for displacement in free_um]
        return free_voltages(self.free_response, free_um, period_s, self.memory)


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
    path: Path | None = None
    begins_mN_per_s: float = 0.0
    """Rate of the force with which a load begins."""
    run_up_s: float = 0.0
    """Of a seek: in which it comes to its speed."""

    @property
    def end_s(self) -> float:
        """When the next one begins."""
        return self.start_s + self.duration_s


def require_bounded(phases: Sequence[tuple[str, float]]) -> None:
    """Refuse phases, each with its duration in s, that take too long together.

    Raises
    ------
    ValueError
        With the time they take, the limit, and the longest of them.
    """
    total_s = fsum(duration_s for _, duration_s in phases)
    if not total_s <= LONGEST_S:
        phase, longest_s = max(phases, key=lambda item: item[1])
        raise ValueError(
            f"it takes {total_s:.4g} s, limit {LONGEST_S:g} s; "
            f"{phase} alone takes {longest_s:.4g} s"
        )


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


def sample_course(
    arm: PlannedArm,
    phases: Sequence[PlannedPhase],
    period_s: float,
    begin_um: float | None = None,
) -> Course:
    """Course of the phases every ``period_s``, from 0 to their end.

    ``begin_um``: where the arm stands; None: at ``arm.x_start_um``.

    Raises
    ------
    ValueError
        Where the period is not finite and positive.
    """
    require_positive("period", period_s, "s")
    course = Course([], [], [], [], [])
    place, force_from_mN = 0, 0.0
    x_from_um = arm.x_start_um if begin_um is None else begin_um
    # The last tick may lie a rounding error beyond the end.
    for tick in range(int(phases[-1].end_s / period_s + 1e-6) + 1):
        t_s = tick * period_s
        phase = phases[place]
        while place + 1 < len(phases) and t_s >= phases[place + 1].start_s:
            x_from_um, force_from_mN = phase.x_um, phase.force_mN
            place += 1
            phase = phases[place]
        x_um, force_mN = _point(arm, phase, t_s - phase.start_s, x_from_um, force_from_mN)
        course.t_s.append(t_s)
        course.phase.append(phase.phase)
        course.x_r_um.append(x_um)
        course.force_r_mN.append(force_mN)
    course.voltage_V.extend(arm.voltages_V(course.x_r_um, course.force_r_mN, period_s))
    return course


def _point(
    arm: PlannedArm, phase: PlannedPhase, t_s: float, x_from_um: float, force_from_mN: float
) -> tuple[float, float]:
    """Position and force at a time since the begin of a phase."""
    if phase.path is not None:
        value = phase.path.at(t_s)
        return (arm.pressed_um(value), value) if phase.path.quantity == "force" else (value, 0.0)
    share = min(1.0, t_s / phase.duration_s)
    if phase.begins_mN_per_s:
        load = move(force_from_mN, phase.begins_mN_per_s, phase.force_mN, 0.0, phase.duration_s)
        return arm.pressed_um(load.position(t_s)), load.position(t_s)
    if phase.kind == "force":
        force_mN = force_from_mN + (phase.force_mN - force_from_mN) * quintic(share)
        return arm.pressed_um(force_mN), force_mN
    if phase.kind == "seek":
        x_um = x_from_um + (phase.x_um - x_from_um) * share
        if phase.run_up_s:
            way_um = phase.x_um - x_from_um
            x_um = x_from_um + run_up(way_um, phase.duration_s, phase.run_up_s, t_s)[0]
        return x_um, max(0.0, arm.stiffness_mN_per_um * (x_um - arm.contact_um))
    return x_from_um + (phase.x_um - x_from_um) * quintic(share), 0.0
