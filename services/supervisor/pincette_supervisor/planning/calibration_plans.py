"""From a request for a calibration to its plan: program, waits, voltages, limits broken."""

from dataclasses import replace
from typing import Any

from pincette.api.calibration_models import CalibrationPlan, RestsOn
from pincette.api.calibration_requests import (
    AnyCalibrationRequest,
    ComplianceRequest,
    ContactStiffnessRequest,
    FreeResponseRequest,
    FrequencyResponseRequest,
    NoiseRequest,
)
from pincette.api.plan_models import Violation
from pincette.config import RigFile, derived
from pincette.control.planning.calibration_programs import (
    compliance_program,
    frequency_response_program,
    noise_program,
    there_and_back,
)
from pincette.control.planning.contact_plan import ContactRequest
from pincette.control.planning.contact_stiffness_program import (
    contact_stiffness_program,
    levels_within,
)
from pincette.control.planning.course import require_bounded
from pincette.control.planning.free_response_program import free_response_program
from pincette.control.planning.program import Program
from pincette_supervisor.model.model_in_use import ModelInUse
from pincette_supervisor.model.quantities import ASSUMED, UNITS, value_of
from pincette_supervisor.planning.calibration_course import planned_phases
from pincette_supervisor.planning.calibration_support import require_sweep
from pincette_supervisor.planning.contact_values import CONTACT_WISHES, contact_wishes, part_values
from pincette_supervisor.planning.laws import rig_law
from pincette_supervisor.planning.planned import Planned, Wait

BELOW_REST = 0.1
"""How far the free motion goes below rest, as a share of its height above."""
GAIN_GROWTH = 1.3
"""By which the gain over a wide stroke may exceed d_p, that at 2 V peak to peak; assumed, and that
of a loop of 18.5 % of the stroke."""
SPEED_FACTOR = 3.0
"""Fastest part of the free motion against the approach."""
SWING_SHARE = 0.5
"""Of the room to the nearest limit of position that the resonance may use up."""
RESTS_ON = {
    "contact_stiffness": ("model.compliance_um_per_mN", "model.free_response"),
}
"""What a calibration takes for granted of the model in use."""
Made = tuple[Program, dict[str, Any], dict[int, Wait]]
"""A program, the values it was made of, and its waits by the number of their segment."""


def plan_calibration(request: AnyCalibrationRequest, model: ModelInUse) -> Planned:
    """Plan a calibration.

    Raises
    ------
    UnsupportedError
        Where the instruments are too slow.
    ValueError
        Where the numbers make no program, or one that a limit of the rig forbids.
    """
    made, values, waits = _made(request, model)
    rig = model.rig
    program = _guarded(made, rig)
    require_bounded([(segment.phase, segment.duration_s or 0.0) for segment in program.segments])
    phases, low_V, high_V = planned_phases(
        program, derived.planned_rig(rig), rig.part.contact_um, rig.safety.safe_V
    )
    for number, wait in waits.items():
        phases[number] = phases[number].model_copy(update={"instruction": wait.instruction})
    violations = _violations(program, rig.limits.sweep_V)
    law = rig_law(rig) if isinstance(request, ContactStiffnessRequest) else None
    if law is not None and not law.assessment.stable:
        violations.append(law.violation())
    plan = CalibrationPlan(
        calibration=request.calibration,
        rig=rig.rig.name,
        feasible=not violations,
        duration_s=phases[-1].start_s + (phases[-1].duration_s or 0.0),
        waits=len(waits),
        phases=phases,
        voltage_min_V=low_V,
        voltage_max_V=high_V,
        violations=violations,
        rests_on=rests_on(request.calibration, model),
        law=None if law is None else law.view(),
    )
    return Planned(plan, program, {"calibration": request.calibration, **values}, model, waits)


def _guarded(program: Program, rig: RigFile) -> Program:
    """Add the limits of position, which no law keeps while the voltage alone moves the arm."""
    limits = rig.limits
    guards = replace(
        program.guards,
        position_min_um=limits.position_min_um,
        position_max_um=limits.position_max_um,
    )
    return replace(program, guards=guards)


def rests_on(calibration: str, model: ModelInUse) -> list[RestsOn]:
    """Quantities that a calibration takes for granted, and where they come from."""
    return [
        RestsOn(
            quantity=quantity,
            value=value_of(model.rig, quantity),
            unit=UNITS[quantity],
            source=model.calibration.sources.get(quantity, ASSUMED),
        )
        for quantity in RESTS_ON.get(calibration, ())
    ]


def _made(request: AnyCalibrationRequest, model: ModelInUse) -> Made:
    match request:
        case NoiseRequest():
            return noise_program(request.duration_s), {"duration_s": request.duration_s}, {}
        case FreeResponseRequest():
            return _free_response(request, model)
        case ComplianceRequest():
            return _compliance(request, model)
        case ContactStiffnessRequest():
            return _contact_stiffness(request, model)
        case FrequencyResponseRequest():
            return _frequency_response(request, model)


def _free_response(request: FreeResponseRequest, model: ModelInUse) -> Made:
    """Over the voltages that a grip needs, within the limits, where the request names no range."""
    rig = model.rig
    limits, d_p, rest_V = rig.limits, rig.model.piezo_um_per_V, rig.safety.safe_V
    high_V = request.high_V
    if high_V is None:
        most_V = rest_V + limits.position_max_um / (GAIN_GROWTH * d_p)
        high_V = min(limits.voltage_max_V, most_V, rest_V + _pressed_um(rig) / d_p)
    low_V = request.low_V
    if low_V is None:
        least_V = rest_V + limits.position_min_um / (GAIN_GROWTH * d_p)
        lowest_V = max(limits.voltage_min_V, least_V)
        low_V = max(lowest_V, rest_V - BELOW_REST * (high_V - rest_V))
    rate = request.rate_V_per_s or SPEED_FACTOR * rig.grip.approach_um_per_s / d_p
    program = free_response_program(
        derived.planned_rig(rig), from_V=low_V, to_V=high_V, rate_V_per_s=rate, rest_V=rest_V
    )
    return program, {"low_V": low_V, "high_V": high_V, "rate_V_per_s": rate}, {}


def _pressed_um(rig: RigFile) -> float:
    """Free travel that the grip's force on the softest and furthest part admitted takes up.

    The arm presses with F at x_e + F/K_e where, free, it would be s_p·F further.
    """
    part, force_mN = rig.part, rig.grip.force_mN
    softest = part.stiffness_mN_per_um * (1.0 - part.stiffness_tolerance)
    pressed_um = part.contact_um + part.contact_tolerance_um + force_mN / softest
    return pressed_um + rig.model.compliance_um_per_mN * force_mN


def _compliance(request: ComplianceRequest, model: ModelInUse) -> Made:
    steps = there_and_back(request.weights_mN)
    program = compliance_program(derived.planned_rig(model.rig), request.weights_mN)
    waiting = [
        number for number, segment in enumerate(program.segments) if segment.duration_s is None
    ]
    waits = {
        number: Wait(_instruction(weight_mN), weight_mN)
        for number, weight_mN in zip(waiting, steps, strict=True)
    }
    values = {
        "weights_mN": list(request.weights_mN),
        "weight_uncertainty": request.weight_uncertainty,
    }
    return program, values, waits


def _instruction(weight_mN: float) -> str:
    what = f"hang {weight_mN:g} mN on the tip" if weight_mN else "take every weight off the tip"
    return f"{what}, then POST the action continue"


def _contact_stiffness(request: ContactStiffnessRequest, model: ModelInUse) -> Made:
    rig = model.rig
    wishes = contact_wishes(request, CONTACT_WISHES, rig)
    contact, planned = ContactRequest(**wishes, **part_values(rig)), derived.planned_rig(rig)
    levels_V = tuple(request.levels_V or levels_within(contact, planned))
    program = contact_stiffness_program(contact, planned, levels_V)
    return program, {"levels_V": list(levels_V), **wishes}, {}


def _frequency_response(request: FrequencyResponseRequest, model: ModelInUse) -> Made:
    rig = model.rig
    require_sweep(rig, request.to_hz, request.capture_hz)
    amplitude_V = request.amplitude_V or _amplitude_V(model)
    program = frequency_response_program(
        derived.planned_rig(rig),
        amplitude_V=amplitude_V,
        damping_ratio=rig.model.damping_ratio,
        rate_hz=request.capture_hz,
        rest_V=rig.safety.safe_V,
        from_hz=request.from_hz,
        to_hz=request.to_hz,
        duration_s=request.duration_s,
    )
    values = request.model_dump(include={"from_hz", "to_hz", "duration_s", "capture_hz"})
    return program, {**values, "amplitude_V": amplitude_V}, {}


def _amplitude_V(model: ModelInUse) -> float:
    """Limit of a sweep, or where less, what moves the arm by a share of its room at resonance."""
    limits, arm = model.rig.limits, model.rig.model
    room_um = min(limits.position_max_um, -limits.position_min_um)
    swing_V = 2.0 * arm.damping_ratio * SWING_SHARE * room_um / arm.piezo_um_per_V
    return min(limits.sweep_V, swing_V)


def _violations(program: Program, sweep_limit_V: float) -> list[Violation]:
    """A sweep that is too wide; every other limit has refused the program as it was made."""
    widest_V = max((s.sweep.amplitude_V for s in program.segments if s.sweep), default=0.0)
    if widest_V <= sweep_limit_V:
        return []
    return [
        Violation(
            pointer="/amplitude_V",
            quantity="amplitude of the sweep",
            value=widest_V,
            limit=sweep_limit_V,
            unit="V",
            at_s=0.0,
            message=f"amplitude_V = {widest_V:g} V is above the limit of {sweep_limit_V:g} V",
        )
    ]
