"""A recorded motion, and a program that repeats its voltages without the part.

The voltages are applied open loop, tick by tick, so that the free arm repeats the hysteresis and
creep of the pressed one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from pincette.control.planning.contact_plan import CONTACT_SAMPLES, ZERO_WAIT_S, PlannedRig
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Drive, Ramp, Recorded
from pincette.control.quantities import MAX_ITEMS

RETURN_S = 0.5
"""Duration of the move to the first voltage of the motion, in s."""
REST_S = 1.0
"""Duration of the rest at the first voltage of the motion, in s."""
SPREAD = 0.005
"""Relative amount by which the voltages of alternate runs are scaled up and down. Later jobs do not
repeat a motion exactly: noise and the contact line change its turning points by about this amount,
and with them the branches of the hysteresis. The differences between the runs show this effect."""


@dataclass(frozen=True, slots=True)
class RecordedSegment:
    """One played segment of a program."""

    phase: str
    voltages_V: tuple[float, ...]
    """Voltages applied at the ticks of the segment, from tick 1, in V."""
    zeroes: bool
    """True if the force was zeroed at the end of the segment."""


class Pressed(NamedTuple):
    """One sample of a pressed part, with the tick whose voltage caused it."""

    segment: int
    tick: int
    x_um: float
    force_mN: float
    """Estimated force, in mN."""


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """The voltages of a job, segment by segment of its program."""

    job: str
    program: str
    """Digest of the program's motion."""
    period_s: float
    segments: tuple[RecordedSegment, ...]
    free_um: tuple[float, float]
    """Lowest and highest position of the free arm under these voltages, x + s_p·F, in µm."""
    pressed: tuple[Pressed, ...] = ()
    """Samples of the pressed part with which a residual table is checked; empty if the job itself
    used a table."""


def recorded_program(
    motion: RecordedMotion, rig: PlannedRig, *, runs: int, contact_force_mN: float, waits: bool
) -> tuple[Program, tuple[int, ...]]:
    """Return a program that plays a motion several times, and the first segment of each run.

    With ``waits`` the program waits for an operator before the first run and after the last one. If
    the arm meets something, it stops and the program ends with ``contact``.

    Raises
    ------
    ValueError
        If the motion has another period, is too long, or moves the free arm beyond a limit.
    """
    limits = rig.limits
    if abs(motion.period_s - rig.period_s) > 1e-9:
        raise ValueError(
            f"job {motion.job} was played every {motion.period_s:g} s, but the period of the "
            f"rig is {rig.period_s:g} s: record the job again"
        )
    for phase, ticks in ((one.phase, len(one.voltages_V)) for one in motion.segments):
        if ticks > MAX_ITEMS:
            raise ValueError(
                f"job {motion.job} has {ticks} ticks of {phase}, limit {MAX_ITEMS}: "
                "play a shorter one"
            )
    low_um, high_um = motion.free_um
    if low_um < limits.position_min_um or high_um > limits.position_max_um:
        raise ValueError(
            f"without the part the voltages of job {motion.job} move the arm from "
            f"{low_um:.2f} µm to {high_um:.2f} µm, limits {limits.position_min_um:g} µm to "
            f"{limits.position_max_um:g} µm: press less, or move the part closer"
        )
    segments: list[Drive] = []
    if waits:
        segments.append(Drive("part away", None))
    begins: list[int] = []
    for run in range(1, runs + 1):
        first_V = motion.segments[0].voltages_V[0]
        width = 1.0 + (SPREAD if run % 2 else -SPREAD)
        segments.append(Drive(f"return {run}", RETURN_S, courses=(Ramp(first_V),)))
        segments.append(Drive(f"rest {run}", REST_S))
        begins.append(len(segments))
        segments += [_played(one, run, rig, first_V, width) for one in motion.segments]
    if waits:
        segments.append(Drive("part back", None))
    guards = Guards(
        contact_force_mN=contact_force_mN,
        contact_samples=CONTACT_SAMPLES,
        force_max_mN=limits.force_max_mN,
        lost_fraction=0.0,
        lost_samples=1,
        stiffness_min_mN_per_um=0.0,
        stiffness_max_mN_per_um=1.0,
        zero_wait_s=ZERO_WAIT_S,
        # In open loop the arm rests slightly beside its position under the law, perhaps too far for
        # a zero beside a part; the residual is relative to that rest all the same.
        zero_needed=False,
    )
    return Program(tuple(segments), guards, contact_stiffness_mN_per_um=1.0), tuple(begins)


def _played(one: RecordedSegment, run: int, rig: PlannedRig, first_V: float, width: float) -> Drive:
    """Return a segment with its recorded ticks, and one more for the stamp if it zeroes."""
    ticks = len(one.voltages_V) - int(one.zeroes)
    low_V, high_V = rig.limits.voltage_min_V, rig.limits.voltage_max_V
    volts = (first_V + width * (voltage_V - first_V) for voltage_V in one.voltages_V)
    values_V = tuple(min(high_V, max(low_V, voltage_V)) for voltage_V in volts)
    return Drive(
        f"{one.phase} {run}",
        ticks * rig.period_s,
        zeroes=one.zeroes,
        guarded=True,
        courses=(Recorded(values_V),),
    )


def chained(force_um: Sequence[float], zeroed: Sequence[bool], rest: int) -> list[float]:
    """Return the residuals of one run, relative to its last zero.

    Each zero changes the offset of x_1. Earlier residuals are shifted by the same amount, so that
    the mean over the rest of the zero is the same before and after it.

    Parameters
    ----------
    force_um
        x - x_1 at each tick as it was estimated, in µm.
    zeroed
        True if the estimate of this tick is the first after a zero.
    rest
        Number of ticks of the rest used for a zero.
    """
    found, shift_um = list(force_um), 0.0
    for place in range(len(found) - 1, -1, -1):
        found[place] += shift_um
        if zeroed[place]:
            # The rest ends with the zeroed sample, which already has the new offset.
            before = force_um[max(0, place - rest) : place]
            if before:
                shift_um -= sum(before) / len(before)
    return found
