"""Open-loop press as in Fig. 8: an approach as in a grip, then swings of four amplitudes about a
mean.

The force is zeroed, the arm seeks the part, and presses it under the law, first lightly to identify
the contact line, then up to the force at the crest of the widest level. From there on the law is
off. The voltage decreases by half the widest level to its mean and swings about it, the widest
level first. So no crest exceeds the force reached under the law, except by creep and by the shift
of hysteresis from cycle to cycle. After the widest swing the narrower ones cause no further shift.
The trough is planned so that the arm stays in contact with the stiffest permitted part. Figure
numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from bisect import bisect_left
from collections.abc import Sequence
from functools import cache

from msgspec.structs import replace

from pincette.control.checks import require_positive
from pincette.control.planning.contact_plan import ContactPlan, PlannedRig, hasty, plan_contact
from pincette.control.planning.contact_request import ContactRequest
from pincette.control.planning.path_shapes import sinusoid, voltage_moves
from pincette.control.planning.planned_arm import PlannedArm
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Follow, Press, Seek

LEVELS_V = (0.3, 1.0, 1.5, 2.0)
"""Peak-to-peak voltages of Fig. 8, in V."""
LEVEL_HZ = 0.5
SETTLING_CYCLES, LEVEL_CYCLES = 2, 4
"""Number of cycles of each level before the measured ones, and number of measured cycles."""
SETTLE_S = 2.0
TROUGH_MN = 3.0
"""Force that remains at the lowest trough, in mN."""
SHIFT = 0.15
"""Fraction by which creep and hysteresis may increase the highest force."""
FIRST_LOAD = 0.25
"""Force at the end of the first load, as a fraction of the crest force. The contact line is
identified during this load."""
LEAST_LOADS = 3.0
"""Smallest force of the first load, as a multiple of the contact force."""
WIDE = 4.0
"""Factor by which the stiffness, which is to be measured, may differ from the planned one."""
LEAST_WIDEST_V = 0.5
"""Smallest peak-to-peak voltage of the widest level, in V. Below this value, noise and the error of
x_1 are too large for a line fit."""
CREST_ROUNDS = 2
"""Number of iterations. Each one computes the swing from the crest force, and then the crest force
from the swing."""
STEP_V = 0.05
"""Step by which the widest level is reduced until it is within the limits, in V."""


def level_phase(number: int) -> str:
    """Return the name of the phase of a level; ``number`` counts from 1."""
    return f"level {number}"


def contact_stiffness_program(
    request: ContactRequest, rig: PlannedRig, levels_V: Sequence[float] = LEVELS_V
) -> Program:
    """Return phases of a grip until ``contact``; ``load``, ``press``, ``mean``, levels, ``unload``.

    Level n, from 1, has phase ``level n``, in the order of ``levels_V``; they are played from the
    widest to the narrowest. The limits are those of a plan that presses with the same force.

    Raises
    ------
    ValueError
        If there are fewer than three levels, one is not positive, or the press breaks a limit.
    """
    if len(levels_V) < 3:
        raise ValueError(f"{len(levels_V)} levels of voltage, must be at least 3")
    for level_V in levels_V:
        require_positive("level of voltage", level_V, "V")
    widest_V = max(levels_V)
    if early := hasty(request, rig, crest_force_mN(request, rig, widest_V)):
        raise ValueError(early[0].message)
    plan = _pressed(request, rig, widest_V)
    if plan.violations:
        broken = plan.violations[0]
        raise ValueError(f"level of {widest_V:g} V peak to peak: {broken.message}")
    rate_V_per_s = 0.5 * widest_V / request.load_s
    lower = voltage_moves(
        [(0.0, rate_V_per_s, 0.0), (-0.5 * widest_V, rate_V_per_s, SETTLE_S)], relative=True
    )
    swings: list[Drive] = []
    for level_V in sorted(levels_V, reverse=True):
        path = sinusoid("voltage", 0.0, level_V, LEVEL_HZ, SETTLING_CYCLES + LEVEL_CYCLES)
        path = replace(path, relative=True)
        phase = level_phase(list(levels_V).index(level_V) + 1)
        swings.append(Drive(phase, path.duration_s, courses=(Follow(path),)))
    planned = plan.program.segments
    seek = next(place for place, segment in enumerate(planned) if isinstance(segment, Seek))
    segments = (
        *planned[: seek + 4],
        Drive("mean", lower.duration_s, courses=(Follow(lower),)),
        *swings,
        Drive("unload", lower.duration_s, courses=(Follow(lower),)),
        planned[-1],
    )
    guards = replace(
        plan.program.guards,
        stiffness_min_mN_per_um=request.stiffness_mN_per_um / WIDE,
        stiffness_max_mN_per_um=request.stiffness_mN_per_um * WIDE,
    )
    # The stiffness is unknown, so only the rig's own limits apply.
    return replace(plan.program, segments=segments, guards=guards, planned_range=None)


def levels_within(request: ContactRequest, rig: PlannedRig) -> tuple[float, ...]:
    """Return ``LEVELS_V`` scaled by one factor so that the widest is within the limits.

    Raises
    ------
    ValueError
        If the widest level would have to be below ``LEAST_WIDEST_V``.
    """
    widest_V = max(LEVELS_V)
    steps = max(0, int((widest_V - LEAST_WIDEST_V) / STEP_V + 1e-9))

    @cache
    def pressed(step: int) -> ContactPlan:
        return _pressed(request, rig, widest_V - step * STEP_V)

    # A narrower level presses and swings less, so that the limits are met after some steps.
    first = 0
    if pressed(0).violations:
        first = bisect_left(range(steps + 1), x=True, key=lambda n: not pressed(n).violations)
    if first > steps:
        broken = pressed(steps).violations[0].message
        raise ValueError(f"level of {widest_V - steps * STEP_V:.2f} V peak to peak: {broken}")
    share = (widest_V - first * STEP_V) / widest_V
    return tuple([round(level_V * share, 3) for level_V in LEVELS_V])


def crest_force_mN(request: ContactRequest, rig: PlannedRig, widest_V: float) -> float:
    """Return the crest force of the widest level that leaves ``TROUGH_MN`` at its trough, in mN.

    It is F_trough + Δ/(s_p + 1/K_e) for the stiffest part, where Δ is the distance by which the
    free arm would move back in the swings, by d_p or by the identified free response, whichever is
    larger.
    """
    series_um_per_mN = rig.compliance_um_per_mN + 1.0 / request.hardest_mN_per_um
    crest_mN = TROUGH_MN + rig.piezo_um_per_V * widest_V / series_um_per_mN
    if rig.free_response is None:
        return crest_mN
    arm = PlannedArm(
        x_start_um=rig.x_start_um,
        piezo_um_per_V=rig.piezo_um_per_V,
        compliance_um_per_mN=rig.compliance_um_per_mN,
        contact_um=request.contact_um,
        stiffness_mN_per_um=request.stiffness_mN_per_um,
        free_response=rig.free_response,
        memory=rig.memory,
    )
    for _ in range(CREST_ROUNDS):
        back_um = arm.swing_um(arm.pressed_um(crest_mN), crest_mN, widest_V, SETTLING_CYCLES)
        crest_mN = max(crest_mN, TROUGH_MN + back_um / series_um_per_mN)
    return crest_mN


def _pressed(request: ContactRequest, rig: PlannedRig, widest_V: float) -> ContactPlan:
    """Return the plan of a press to the crest of the widest level, with a reserve of ``SHIFT``."""
    crest_mN, load_s = crest_force_mN(request, rig, widest_V), request.load_s
    first_mN = min(crest_mN, max(LEAST_LOADS * request.contact_force_mN, FIRST_LOAD * crest_mN))
    highest_mN = (1.0 + SHIFT) * crest_mN
    pressing = (
        Press("load", load_s, to_mN=first_mN),
        Press("load", load_s, to_mN=request.contact_force_mN),
        Press("press", load_s + SETTLE_S, to_mN=crest_mN, move_s=load_s),
        Press("highest", load_s, to_mN=highest_mN),
        Press("unload", load_s, to_mN=0.0),
    )
    pointers = {segment.phase: "/levels_V" for segment in pressing}
    return plan_contact(request, rig, pressing, pointers)
