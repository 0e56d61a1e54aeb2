"""The uncertainty that the force of a plan would be stated with, and forces that are not above it.

Only what the model in use has found counts: the noise of the sensor, and the error of an identified
free response over the way from its zero. Creep and drift come on top, and so does a past that is
not known, which is stated by itself.
"""

from msgspec.structs import replace

from pincette.config import RigFile, derived
from pincette.control.force.estimation import COVERAGE, uncertainty
from pincette.control.planning.contact_request import MARGIN_UM
from pincette.control.planning.feasibility import Violation
from pincette.control.planning.touch_force import least_force_mN, uncertain_force
from pincette.control.response.identified_response import IdentifiedResponse
from pincette.control.response.unknown_past import standard_uncertainty_um, unknown_past


def force_uncertainty_mN(rig: RigFile, way_um: float, *, conditioned: bool = False) -> float:
    """Return the expanded uncertainty of the force after the free arm has moved ``way_um``.

    Parameters
    ----------
    conditioned
        Whether the plan begins with conditioning strokes.
    """
    model, free_error_um = rig.model, 0.0
    if model.free_response is not None:
        way_V = way_um / model.piezo_um_per_V
        response = derived.free_response(model)
        if isinstance(response, IdentifiedResponse):
            response = replace(response, conditioned=conditioned)
        free_error_um = response.begin(0.0).follow(way_V, 0.0).error_um()
    return uncertainty(
        noise_um=rig.sensor.noise_um,
        free_error_um=free_error_um,
        compliance_um_per_mN=model.compliance_um_per_mN,
        creep_mN_per_decade=0.0,
        zero_age_s=0.0,
        forgotten_mN=0.0,
    )


def past_uncertainty_mN(rig: RigFile, force_mN: float) -> float:
    """Return the expanded uncertainty that an unknown past of the arm adds to a force, in mN.

    The arm may have rested at either end of its voltages before it came to its rest. It is zeroed
    before the part, and goes on from there. 0 where the past adds less than the model's own error.
    """
    model, limits, part = rig.model, rig.limits, rig.part
    response = derived.free_response(model)
    ends_V = (limits.voltage_min_V, limits.voltage_max_V)
    unknown = unknown_past(response, ends_V).judged(response)
    if unknown.known:
        return 0.0
    d_p, s_p = model.piezo_um_per_V, model.compliance_um_per_mN
    zero_um = part.contact_um - part.contact_tolerance_um - MARGIN_UM
    pressed_um = part.contact_um + force_mN * (s_p + 1.0 / part.stiffness_mN_per_um)
    zero_V, pressed_V = zero_um / d_p, min(limits.voltage_max_V, pressed_um / d_p)
    rest_V = rig.safety.safe_V
    zeroed = response.follow(rest_V, 0.0).follow(zero_V, 0.0)
    unknown = unknown.follow(rest_V, 0.0).follow(zero_V, 0.0).rezero(zeroed)
    error_um = unknown.follow(pressed_V, 0.0).error_um(zeroed.follow(pressed_V, 0.0))
    return COVERAGE * standard_uncertainty_um(error_um) / s_p


def hidden_by_past(rig: RigFile, force_mN: float, pointer: str) -> tuple[Violation, ...]:
    """Return the violation of a force that the arm's unknown past would cover.

    Such a load ends as ``uncertain_force``. Only for arms that conditioning strokes would help.
    """
    uncertainty_mN = past_uncertainty_mN(rig, force_mN)
    if force_mN > uncertainty_mN or derived.conditioning_V(rig) is None:
        return ()
    message = (
        f"force = {force_mN:g} mN is not above {uncertainty_mN:.3g} mN, the expanded uncertainty "
        "of the force by the arm's past, which is not known: let conditioning strokes come first "
        '(condition = "auto"), or state more than that'
    )
    return (Violation(pointer, "force", force_mN, uncertainty_mN, "mN", 0.0, message),)


def uncertain_forces(
    rig: RigFile,
    contact_force_mN: float,
    force_mN: float,
    pointer: str,
    *,
    conditioned: bool = False,
) -> tuple[Violation, ...]:
    """Return the violations of a touch or a force that its own uncertainty would cover.

    Noise and the error of the model would show a touch where there is none below that force.

    Parameters
    ----------
    rig
        Rig of one arm.
    force_mN
        Highest force of the plan, and
    pointer
        the member of the request that it comes from.
    conditioned
        Whether the plan begins with conditioning strokes.
    """
    seek_um = 2.0 * (rig.part.contact_tolerance_um + MARGIN_UM)
    s_p, K_e = rig.model.compliance_um_per_mN, rig.part.stiffness_mN_per_um
    pressed_um = seek_um + force_mN * (s_p + 1.0 / K_e)
    touched_um = seek_um + contact_force_mN * s_p
    at_touch_mN = force_uncertainty_mN(rig, touched_um, conditioned=conditioned)
    touch = uncertain_force(contact_force_mN, at_touch_mN, "/contact_force_mN", "contact_force_mN")
    if force_mN <= least_force_mN(contact_force_mN):
        return touch  # refused as a weak force
    pressed_mN = force_uncertainty_mN(rig, pressed_um, conditioned=conditioned)
    return (*touch, *uncertain_force(force_mN, pressed_mN, pointer, "force"))
