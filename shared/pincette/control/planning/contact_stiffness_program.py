"""The press in voltage of Fig. 8: the way to a part as for a grip, then four levels about a mean.

The arm is zeroed, seeks the part, and presses under the law, first lightly, which identifies
the contact line, then until the force at the crest of the widest level. From the voltage that this
took the law is off: the voltage falls by half the widest level, to its mean, and swings about it,
the widest level first. So no crest is higher than the force that was reached under the law, but
for creep and for what a hysteresis shifts from cycle to cycle, whichever branch it is on; and once
it has been through the widest swing the others shift it no more. The trough is planned to stay in
contact with the stiffest part that is admitted. Figure numbers are those of Q. Xu, IEEE T-ASE
10(3), 2013.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from pincette.control.checks import require_positive
from pincette.control.planning.contact_plan import ContactPlan, PlannedRig, plan_contact
from pincette.control.planning.contact_request import ContactRequest
from pincette.control.planning.path_shapes import sinusoid, voltage_moves
from pincette.control.planning.program import Program, Segment

LEVELS_V = (0.3, 1.0, 1.5, 2.0)
"""Peak to peak, of Fig. 8."""
LEVEL_HZ = 0.5
SETTLING_CYCLES, LEVEL_CYCLES = 2, 4
"""Of each level: before those that are measured, and those."""
SETTLE_S = 2.0
TROUGH_MN = 3.0
"""Force that is to be left at the lowest trough."""
SHIFT = 0.15
"""Share of the highest force by which creep and hysteresis may raise it."""
FIRST_LOAD = 0.25
"""Share of the highest force that the line of the contact is taken from, and"""
LEAST_LOADS = 3.0
"""times the contact force that it is at least."""
WIDE = 4.0
"""Factor by which the stiffness may differ from the plan: it is what is looked for."""
LEAST_WIDEST_V = 0.5
"""Widest level below which noise and an error of x_1 leave too little of the line."""
STEP_V = 0.05
"""By which the widest level is lowered until it is within the limits."""


def level_phase(number: int) -> str:
    """Name of the phase of a level, from 1."""
    return f"level {number}"


def contact_stiffness_program(
    request: ContactRequest, rig: PlannedRig, levels_V: Sequence[float] = LEVELS_V
) -> Program:
    """Phases of a grip until ``contact``; ``load``, ``press``, ``mean``, levels, ``unload``.

    Level n, from 1, has phase ``level n``, in the order of ``levels_V``; they are played from the
    widest to the narrowest. The limits are those of a plan that presses as far.

    Raises
    ------
    ValueError
        Where there are fewer than three levels, one is not positive, or the press breaks a limit.
    """
    if len(levels_V) < 3:
        raise ValueError(f"{len(levels_V)} levels of voltage, must be at least 3")
    for level_V in levels_V:
        require_positive("level of voltage", level_V, "V")
    widest_V = max(levels_V)
    plan = _pressed(request, rig, widest_V)
    if plan.violations:
        broken = plan.violations[0]
        raise ValueError(f"level of {widest_V:g} V peak to peak: {broken.message}")
    rate_V_per_s = 0.5 * widest_V / request.load_s
    lower = voltage_moves(
        [(0.0, rate_V_per_s, 0.0), (-0.5 * widest_V, rate_V_per_s, SETTLE_S)], relative=True
    )
    swings: list[Segment] = []
    for level_V in sorted(levels_V, reverse=True):
        path = sinusoid("voltage", 0.0, level_V, LEVEL_HZ, SETTLING_CYCLES + LEVEL_CYCLES)
        path = replace(path, relative=True)
        phase = level_phase(list(levels_V).index(level_V) + 1)
        swings.append(Segment(phase, "voltage", path.duration_s, path=path))
    planned = plan.program.segments
    seek = next(place for place, segment in enumerate(planned) if segment.kind == "seek")
    segments = (
        *planned[: seek + 4],
        Segment("mean", "voltage", lower.duration_s, path=lower),
        *swings,
        Segment("unload", "voltage", lower.duration_s, path=lower),
        planned[-1],
    )
    guards = replace(
        plan.program.guards,
        stiffness_min_mN_per_um=request.stiffness_mN_per_um / WIDE,
        stiffness_max_mN_per_um=request.stiffness_mN_per_um * WIDE,
    )
    # The stiffness is what is looked for: only the rig's own limits hold.
    return replace(plan.program, segments=segments, guards=guards, planned_range=None)


def levels_within(request: ContactRequest, rig: PlannedRig) -> tuple[float, ...]:
    """``LEVELS_V`` scaled down alike until the widest is within the limits of the rig.

    Raises
    ------
    ValueError
        Where it would have to be below ``LEAST_WIDEST_V``.
    """
    widest_V = max(LEVELS_V)
    steps = int((widest_V - LEAST_WIDEST_V) / STEP_V + 1e-9)
    broken = ""
    for step in range(max(0, steps) + 1):
        tried_V = widest_V - step * STEP_V
        plan = _pressed(request, rig, tried_V)
        if not plan.violations:
            return tuple([round(level_V * (tried_V / widest_V), 3) for level_V in LEVELS_V])
        broken = f"level of {tried_V:.2f} V peak to peak: {plan.violations[0].message}"
    raise ValueError(broken)


def crest_force_mN(request: ContactRequest, rig: PlannedRig, widest_V: float) -> float:
    """Force at the crest of the widest level: F_trough + d_p·U/(s_p + 1/K_e), for the stiffest."""
    stiffest = request.stiffness_mN_per_um * (1.0 + request.stiffness_tolerance)
    return TROUGH_MN + rig.piezo_um_per_V * widest_V / (rig.compliance_um_per_mN + 1.0 / stiffest)


def _pressed(request: ContactRequest, rig: PlannedRig, widest_V: float) -> ContactPlan:
    """The plan of a press by force as far as the widest level may go, and its shift beyond."""
    crest_mN, load_s = crest_force_mN(request, rig, widest_V), request.load_s
    first_mN = min(crest_mN, max(LEAST_LOADS * request.contact_force_mN, FIRST_LOAD * crest_mN))
    highest_mN = (1.0 + SHIFT) * crest_mN
    pressing = (
        Segment("load", "force", load_s, force_to_mN=first_mN),
        Segment("load", "force", load_s, force_to_mN=request.contact_force_mN),
        Segment("press", "force", load_s + SETTLE_S, force_to_mN=crest_mN, move_s=load_s),
        Segment("highest", "force", load_s, force_to_mN=highest_mN),
        Segment("unload", "force", load_s, force_to_mN=0.0),
    )
    pointers = {segment.phase: "/levels_V" for segment in pressing}
    return plan_contact(request, rig, pressing, pointers)
