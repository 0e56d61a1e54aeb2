"""Uncertainty of the force in a plan, and violations for forces that do not exceed it.

It includes only what the model in use has identified: the noise of the sensor, and the error of an
identified free response over the distance from its zero. Creep and drift are additional, and so is
an unknown history, whose uncertainty is stated separately. Oscillation of the mode contributes a
term that a plan can reduce.
"""

from math import pi
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from pincette.api.predictions import Violation as PlanViolation
from pincette.config import ConfigError, RigFile, derived
from pincette.control.force.estimation import COVERAGE, uncertainty
from pincette.control.force.ring import ring_amplitudes_um
from pincette.control.planning.contact_plan import ContactPlan
from pincette.control.planning.contact_request import MARGIN_UM
from pincette.control.planning.feasibility import Violation
from pincette.control.planning.touch_force import least_force_mN, uncertain_force
from pincette.control.response.identified_response import IdentifiedResponse
from pincette.control.response.unknown_past import standard_uncertainty_um, unknown_past
from pincette.control.stability.refusal import RC_S
from pincette.core import plugins
from pincette.engine.timing_budget import budget, stated_output

WARNED_SHARE = 0.05
"""Ratio of the oscillation term to the planned force, or to its peak-to-peak value, above which
a warning is given."""


def force_uncertainty_mN(rig: RigFile, way_um: float, *, conditioned: bool = False) -> float:
    """Return the expanded force uncertainty, in mN, after the free arm has moved by ``way_um``.

    Parameters
    ----------
    conditioned
        True if the plan begins with conditioning strokes.
    """
    model, free_error_um, rehearsals = rig.model, 0.0, 0
    if model.free_response is not None:
        way_V = way_um / model.piezo_um_per_V
        moved = derived.free_response(model).begin(0.0).updated(way_V, 0.0)
        free_error_um = moved.error_um()
        if isinstance(moved, IdentifiedResponse):
            moved = replace(moved, conditioned=conditioned)
            free_error_um, rehearsals, _ = moved.rehearsed()
    return uncertainty(
        noise_um=rig.sensor.noise_um,
        free_error_um=free_error_um,
        compliance_um_per_mN=model.compliance_um_per_mN,
        creep_mN_per_decade=0.0,
        zero_age_s=0.0,
        forgotten_mN=0.0,
        few_um=free_error_um,
        rehearsals=rehearsals,
    )


def past_uncertainty_mN(rig: RigFile, force_mN: float) -> float:
    """Return the expanded force uncertainty due to the arm's unknown history, in mN.

    Before its present rest the arm may have rested at either end of its voltage range. The force is
    zeroed before the arm reaches the part, and the arm continues from there. The result is 0 if the
    history adds less than the error of the model.
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
    zeroed = response.updated(rest_V, 0.0).updated(zero_V, 0.0)
    unknown = unknown.updated(rest_V, 0.0).updated(zero_V, 0.0).rezero(zeroed)
    error_um = unknown.updated(pressed_V, 0.0).error_um(zeroed.updated(pressed_V, 0.0))
    return COVERAGE * standard_uncertainty_um(error_um) / s_p


def hidden_by_past(rig: RigFile, force_mN: float, pointer: str) -> tuple[Violation, ...]:
    """Return the violation if the requested force is below the uncertainty due to the unknown
    history.

    The load would end as ``uncertain_force``, unless the approach reduces that uncertainty.
    """
    uncertainty_mN = past_uncertainty_mN(rig, force_mN)
    if force_mN > uncertainty_mN or derived.approach_tells(rig):
        return ()
    remedy = 'request conditioning strokes (condition = "auto")'
    if derived.conditioning_V(rig) is None:
        remedy = "move the arm over its whole range without the part before"
    message = (
        f"force = {force_mN:g} mN is not above {uncertainty_mN:.3g} mN, the expanded "
        f"uncertainty of the force from the arm's unknown past: {remedy}, or request a "
        "larger force"
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
    """Return violations of a contact force or a highest force that is below its own uncertainty.

    A force below its uncertainty cannot be distinguished from noise and the error of the model.

    Parameters
    ----------
    rig
        Rig of one arm.
    force_mN
        Highest force of the plan, in mN.
    pointer
        Member of the request that determines that force.
    conditioned
        True if the plan begins with conditioning strokes.
    """
    seek_um = 2.0 * (rig.part.contact_tolerance_um + MARGIN_UM)
    s_p, K_e = rig.model.compliance_um_per_mN, rig.part.stiffness_mN_per_um
    pressed_um = seek_um + force_mN * (s_p + 1.0 / K_e)
    touched_um = seek_um + contact_force_mN * s_p
    at_touch_mN = force_uncertainty_mN(rig, touched_um, conditioned=conditioned)
    touch = uncertain_force(contact_force_mN, at_touch_mN, "/contact_force_mN", "contact_force_mN")
    if force_mN <= least_force_mN(contact_force_mN):
        return touch  # another check rejects such a weak force
    pressed_mN = force_uncertainty_mN(rig, pressed_um, conditioned=conditioned)
    return (*touch, *uncertain_force(force_mN, pressed_mN, pointer, "force"))


class RingTerm(NamedTuple):
    """Largest contribution of oscillation of the mode to the uncertainty U in the goal phase of
    a plan."""

    force_mN: float
    at_s: float
    """Time of the largest contribution in the plan, in s."""
    share: float
    """Ratio of the contribution to the peak-to-peak value of the planned force, or to a steady
    force."""


def ring_term(made: ContactPlan, rig: RigFile, phase: str, settling_s: float = 0.0) -> RingTerm:
    """Return the contribution of oscillation in one phase of a plan.

    The drivers' statement is used if the output delay has never been measured.

    Parameters
    ----------
    phase
        Goal phase of the job.
    settling_s
        Time from the start of the phase that is left out, in s.
    """
    course = made.course
    shares = derived.ring_shares(rig, stated_output(rig))
    steps_um = rig.model.piezo_um_per_V * np.diff(course.voltage_V, prepend=course.voltage_V[0])
    amplitudes_um = np.array(ring_amplitudes_um(steps_um.tolist(), shares.kept))
    t_s, force_mN = np.array(course.t_s), np.array(course.force_r_mN)
    places = np.flatnonzero(np.array(course.phase) == phase)
    if places.size:
        places = places[t_s[places] >= t_s[places[0]] + settling_s]
    if not places.size or shares.pressed == 0.0:
        return RingTerm(0.0, 0.0, 0.0)
    largest = places[int(np.argmax(amplitudes_um[places]))]
    ring_um = COVERAGE * shares.pressed * float(amplitudes_um[largest])
    found_mN = ring_um / rig.model.compliance_um_per_mN
    swing_mN = float(np.ptp(force_mN[places])) or float(np.max(np.abs(force_mN[places])))
    share = found_mN / swing_mN if swing_mN > 0.0 else 0.0
    return RingTerm(found_mN, float(t_s[largest]), share)


def ring_remedy(rig: RigFile) -> str:
    """Return a measure that reduces the oscillation on a rig, in words."""
    if rig.shaping_s is not None or rig.model.output_lag_s >= RC_S:
        return "move more slowly"
    if _shapes(rig):
        return "set [output] shaping = true, or move more slowly"
    return (
        f"fit an RC of {1e3 * RC_S:.1f} ms before the amplifier and state it as "
        f"[model] output_lag_s = {RC_S:g}, or move more slowly"
    )


def ring_violation(term: RingTerm, rig: RigFile, tolerance_mN: float | None) -> list[PlanViolation]:
    """Return the violation of a plan whose oscillation exceeds the requested tolerance; otherwise
    an empty list.
    """
    if tolerance_mN is None or term.force_mN <= tolerance_mN:
        return []
    mode_hz = rig.model.natural_frequency_rad_per_s / (2.0 * pi)
    return [
        PlanViolation(
            pointer="/force_tolerance_mN",
            quantity="force",
            side="above",
            value=term.force_mN,
            limit=tolerance_mN,
            unit="mN",
            at_s=term.at_s,
            message=(
                f"the steps of the voltage ring the mode at {mode_hz:.0f} Hz, which makes "
                f"the force uncertain by {term.force_mN:.2f} mN, above force_tolerance_mN = "
                f"{tolerance_mN:g} mN: {ring_remedy(rig)}"
            ),
        )
    ]


def ring_warning(term: RingTerm, rig: RigFile) -> list[str]:
    """Return a warning if oscillation makes the force of a plan uncertain; otherwise empty."""
    if term.share < WARNED_SHARE:
        return []
    return [
        "the steps of the voltage ring the mode: this makes the force uncertain by "
        f"{term.force_mN:.2f} mN ({100.0 * term.share:.0f} % of the planned force, warned "
        f"from {100.0 * WARNED_SHARE:g} %): {ring_remedy(rig)}"
    ]


def _shapes(rig: RigFile) -> bool:
    """Return whether the output of a rig with one arm can time the parts of a step."""
    if rig.second is not None:
        return False
    try:
        return budget(rig).outputs[0].buffered_hz is not None
    except (ConfigError, plugins.PluginError):
        return False
