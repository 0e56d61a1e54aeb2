"""Common parts of plans of two arms: contact values, law and its assessment, curves."""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

from msgspec.structs import replace

from pincette.api.pairs import PairCurves, PairPlan
from pincette.api.plans import Law
from pincette.api.requests import Gains, JobRequest
from pincette.config import RigFile, derived
from pincette.config.derived import X_START_UM
from pincette.control.laws.parameters import Gain, LawSpec
from pincette.control.laws.two_arm_law import LAW
from pincette.control.laws.two_arms import Pair
from pincette.control.planning.contact_plan import PlannedRig, voltage_range
from pincette.control.planning.contact_request import MARGIN_UM
from pincette.control.planning.feasibility import Violation as Broken
from pincette.control.planning.feasibility import named_violation
from pincette.control.planning.motion_plan import named_pointer
from pincette.control.planning.pair_plan import PairRequest
from pincette.control.planning.pair_prediction import (
    HeldPair,
    PairCourse,
    after_strokes,
    broken_limits,
    pair_conditioning,
    predict_held_pair,
    predict_pair,
)
from pincette.control.planning.planned_arm import PlannedArm
from pincette.control.planning.program import PlannedRange, Program
from pincette.control.planning.sampling import unsampled
from pincette.control.planning.touch_force import SafeTouch, weak_force
from pincette.control.stability.two_arms import TwoArmLoop, assess_two_arms
from pincette.core.wording import fault_text
from pincette_supervisor.plugin import FaultyRequestError, Planned, Present, decimated, stride_of
from pincette_supervisor.plugin.laws import judgement, unstable
from pincette_supervisor.plugin.model_in_use import ModelInUse
from pincette_supervisor.plugin.plans import (
    CONTACT_FIELDS,
    held_warnings,
    planned_phase,
    unconditioned,
    unidentified,
    usual_conditioning_V,
    violation_view,
)
from pincette_supervisor.plugin.stated_uncertainty import uncertain_forces

STARTS_UM: Pair = (X_START_UM, X_START_UM)
assessed = lru_cache(maxsize=16)(assess_two_arms)


def contacts_um(rig: RigFile) -> Pair:
    """Return the tip positions of both arms at the first contact with the part, in µm.

    Raises FaultyRequestError on a rig with one arm.
    """
    if rig.second is None:
        raise FaultyRequestError("/kind", "this rig has one driven arm, but the job needs two")
    return rig.part.contact_um, rig.second.contact_um


def pair_request(
    values: dict[str, Any], rig: RigFile, force_mN: float, *, centred: bool
) -> PairRequest:
    """Return the parameters of the search for the part.

    Raises ValueError for an impossible number.
    """
    first, second = rig.arms
    return PairRequest(
        **{name: values[name] for name in CONTACT_FIELDS},
        force_mN=force_mN,
        zero_s=rig.grip.zero_s,
        contacts_um=contacts_um(rig),
        contact_tolerance_um=rig.part.contact_tolerance_um,
        stiffness_mN_per_um=rig.part.stiffness_mN_per_um,
        centred=centred,
        compliances_um_per_mN=(
            first.model.compliance_um_per_mN,
            second.model.compliance_um_per_mN,
        ),
    )


def pair_hasty(
    values: dict[str, Any], rig: RigFile, force_mN: float, pointer: str
) -> tuple[Broken, ...]:
    """Return violations of a contact that is too fast, and of forces below the noise.

    The speed of the seek is the sum of the speeds of both arms; that of an approach is the speed of
    one arm.
    """
    part, arms = rig.part, rig.arms
    compliances = [arm.model.compliance_um_per_mN for arm in arms]
    found: list[Broken] = []
    for name, s_p in (
        ("seek_um_per_s", sum(compliances)),
        ("approach_um_per_s", min(compliances)),
    ):
        touch = SafeTouch(
            force_mN,
            values["contact_force_mN"],
            part.stiffness_mN_per_um * (1.0 + part.stiffness_tolerance),
            s_p,
            rig.rig.period_s,
        )
        found += touch.violations({name: values[name]})
    for arm in arms:
        found += uncertain_forces(arm, values["contact_force_mN"], force_mN, pointer)
    return tuple(found)


def homes_um(rig: RigFile, request: PairRequest, highest_mN: float) -> Pair:
    """Return the positions to which both arms return from a force; see ``PlannedArm.home_um``."""
    first, second = (
        PlannedArm(
            X_START_UM,
            arm.model.piezo_um_per_V,
            arm.model.compliance_um_per_mN,
            contact_um=furthest_um,
            stiffness_mN_per_um=request.stiffness_mN_per_um,
            free_response=derived.identified_hysteresis(arm.model),
            memory=derived.begin_memory(arm.model),
        ).home_um(
            furthest_um + highest_mN / request.stiffness_mN_per_um,
            highest_mN,
            stand_off_um=stand_off_um,
            voltage_min_V=arm.limits.voltage_min_V,
        )
        for arm, furthest_um, stand_off_um in zip(
            rig.arms, request.furthest_um, request.stand_offs_um, strict=True
        )
    )
    return first, second


def most_mN(rig: RigFile) -> float:
    """Return the highest force permitted for either arm, in mN."""
    return min(arm.limits.force_max_mN for arm in rig.arms)


def pair_job(
    request: JobRequest,
    model: ModelInUse,
    program: Program,
    values: dict[str, Any],
    pointers: dict[str, str],
    present: Present,
    held: HeldPair | None = None,
    broken: Iterable[Broken] = (),
) -> Planned:
    """Add the law to a program; limits that either arm's course exceeds are violations.

    Arms that are free when the program begins make conditioning strokes first, if the rig file's
    grip requires them.

    Parameters
    ----------
    held
        Arms that hold the part at the beginning; None if they rest without a part.
    broken
        Violations that the caller has found.
    """
    rig = model.rig
    first, second = rig.arms
    depths_V = [None if held else usual_conditioning_V(arm) for arm in rig.arms]
    rigs = (
        derived.planned_rig(first, present.x_um, depths_V[0]),
        derived.planned_rig(second, present.second_um, depths_V[1]),
    )
    # Segments of voltage alone come after the end of the plan, and are played only if a person
    # releases the part.
    led = replace(program, segments=tuple(s for s in program.segments if not s.open_loop))
    if held is None:
        course = predict_pair(led, rigs, STARTS_UM, contacts_um(rig))
    else:
        course = predict_held_pair(led, rigs, held)
    strokes = pair_conditioning(rigs)
    if strokes is not None:
        course = after_strokes(course, strokes)
        program = replace(program, segments=(*strokes.segments, *program.segments))
    spec, loop = chosen_law(request, rig)
    assessment = assessed(loop)
    violations = [
        *map(violation_view, broken),
        *(
            violation_view(named_violation(found, named_pointer(found, pointers))).model_copy(
                update={"message": f"arm {arm}: {named_violation(found, '').message}"}
            )
            for arm, found in broken_limits(course, rigs)
        ),
    ]
    if held is None:
        force_mN = max(course.arms[0].force_r_mN)
        load_at_s = next(phase.start_s for phase in course.phases if phase.phase == "load")
        weak = weak_force(
            force_mN,
            program.guards.contact_force_mN,
            pointers.get("load", ""),
            load_at_s,
        )
        early = pair_hasty(values, rig, force_mN, pointers.get("load", ""))
        violations = [*map(violation_view, (*weak, *early)), *violations]
    violations += unstable(assessment)
    past = held_warnings(present) if held else _past_warnings(depths_V, rig, present)
    plan = PairPlan(
        kind=request.kind,
        rig=rig.rig.name,
        feasible=not violations,
        duration_s=course.duration_s,
        phases=[planned_phase(phase) for phase in course.phases],
        violations=violations,
        curves=_curves(course),
        law=Law(
            scheme=LAW.name,
            set="identified",
            gains=dict(loop.gains),
            force_age="newest",
            gains_from="default" if getattr(request, "gains", None) is None else "request",
            **judgement(assessment),
        ),
        warnings=list(
            dict.fromkeys(
                [
                    *unidentified(first),
                    *unidentified(second),
                    *past,
                    *unsampled(program.segments, rig.rig.period_s),
                ]
            )
        ),
    )
    values = {**values, "law": plan.law.model_dump()}
    planned_range = None if held else pair_range(course, rigs, rig)
    armed = replace(program, laws=(spec,), planned_range=planned_range)
    return Planned(plan, armed, values, model, pointers=pointers)


def _past_warnings(depths_V: Sequence[float | None], rig: RigFile, present: Present) -> list[str]:
    """Return warnings of what is assumed or unknown about history and stroke of both arms."""
    found = [
        words
        for arm, depth_V in zip(rig.arms, depths_V, strict=True)
        for words in unconditioned(depth_V is not None, arm, present)
    ]
    return found if present.stroke is None else [*found, fault_text(present.stroke)]


def pair_range(
    course: PairCourse, rigs: tuple[PlannedRig, PlannedRig], rig: RigFile
) -> PlannedRange:
    """Return the voltage ranges of both arms, for a part anywhere within its tolerances.

    There is none for arms that already hold a part, since the force by which their voltages differ
    from those of free arms is unknown.
    """
    part, force_mN = rig.part, max(course.arms[0].force_r_mN)
    deeper_um = force_mN / part.stiffness_mN_per_um * part.stiffness_tolerance
    on_um = part.contact_tolerance_um + MARGIN_UM + deeper_um
    voltages = tuple(
        voltage_range([*arm.voltage_V, max(arm.voltage_V) + on_um / of.piezo_um_per_V], of)
        for arm, of in zip(course.arms, rigs, strict=True)
    )
    return PlannedRange(voltages, force_max_mN=force_mN)


def chosen_law(request: JobRequest, rig: RigFile) -> tuple[LawSpec, TwoArmLoop]:
    """Return the law of both arms with its gains.

    Raises FaultyRequestError for an impossible gain.
    """
    asked: Gains | str | None = getattr(request, "gains", None)
    if isinstance(asked, str):
        raise FaultyRequestError(
            "/gains",
            f"gains = {asked!r} is for 1 driven arm, but this rig has 2: give the gains by name",
        )
    named = () if asked is None else tuple(Gain(n, v) for n, v in asked.by_name.items())
    first, second = (arm.model.arm() for arm in rig.arms)
    period_s = rig.rig.period_s
    try:
        gains = LAW.gains(LawSpec(LAW.name, gains=named), (first, second), period_s)
    except ValueError as error:
        raise FaultyRequestError("/gains", str(error)) from error
    c = 1.0 / rig.part.stiffness_mN_per_um
    output = rig.model.output(period_s)
    loop = TwoArmLoop((first, second), tuple(gains.items()), period_s, c, output)
    return LAW.spec(gains), loop


def _curves(course: PairCourse) -> PairCurves:
    first, second = course.arms
    stride = stride_of(first)
    return PairCurves(
        **decimated(first).model_dump(),
        place_r_um=course.place_um[::stride],
        second_x_r_um=second.x_r_um[::stride],
        second_voltage_V=second.voltage_V[::stride],
    )
