"""Share of the force uncertainty that the ring of the mode has in a plan, and what reduces it."""

from math import pi
from typing import NamedTuple

import numpy as np

from pincette.api.predictions import Violation
from pincette.config import ConfigError, RigFile, derived
from pincette.control.force.ring import ring_amplitudes_um
from pincette.control.planning.contact_plan import ContactPlan
from pincette.core import plugins
from pincette.engine.timing_budget import budget, stated_output

COVERAGE = 2.0
"""Standard uncertainties in U."""
WARNED_SHARE = 0.05
"""Share of the planned force, or of its swing, from which on the term is worth a warning."""
RC_S = 0.0033
"""Time constant of the RC before the amplifier that is proposed."""


class RingTerm(NamedTuple):
    """Largest contribution of the ring to U in the goal phase of a plan."""

    force_mN: float
    at_s: float
    """Time in the plan."""
    share: float
    """The contribution over the swing of the planned force; of a steady force, over that."""


def ring_term(made: ContactPlan, rig: RigFile, phase: str, settling_s: float = 0.0) -> RingTerm:
    """Return the contribution of the ring in one phase of a plan.

    Where nobody has measured when a voltage acts, the drivers' statement counts.

    Parameters
    ----------
    phase
        Goal phase of the job.
    settling_s
        Time from the begin of the phase that does not count.
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
    """Return what makes the ring smaller on a rig."""
    if rig.shaping_s is not None or rig.model.output_lag_s >= RC_S:
        return "move more slowly"
    if _shapes(rig):
        return "set [output] shaping = true, or move more slowly"
    return (
        f"fit an RC of {1e3 * RC_S:.1f} ms before the amplifier and state it as "
        f"[model] output_lag_s = {RC_S:g}, or move more slowly"
    )


def ring_violation(term: RingTerm, rig: RigFile, tolerance_mN: float | None) -> list[Violation]:
    """Return that a plan cannot keep the tolerance it was asked for; empty where it can."""
    if tolerance_mN is None or term.force_mN <= tolerance_mN:
        return []
    mode_hz = rig.model.natural_frequency_rad_per_s / (2.0 * pi)
    return [
        Violation(
            pointer="/force_tolerance_mN",
            quantity="force",
            side="above",
            value=term.force_mN,
            limit=tolerance_mN,
            unit="mN",
            at_s=term.at_s,
            message=(
                f"the steps of the voltage ring the mode at {mode_hz:.0f} Hz, by which the force "
                f"is uncertain by {term.force_mN:.2f} mN, above force_tolerance_mN = "
                f"{tolerance_mN:g} mN: {ring_remedy(rig)}"
            ),
        )
    ]


def ring_warning(term: RingTerm, rig: RigFile) -> list[str]:
    """Return a warning where the ring makes the force of a plan uncertain; empty where not."""
    if term.share < WARNED_SHARE:
        return []
    return [
        f"the steps of the voltage ring the mode: the force is uncertain by {term.force_mN:.2f} mN "
        f"from it ({100.0 * term.share:.0f} % of the planned force, warned from "
        f"{100.0 * WARNED_SHARE:g} %): {ring_remedy(rig)}"
    ]


def _shapes(rig: RigFile) -> bool:
    """Return whether the output of a rig of one arm can time the parts of a step."""
    if rig.second is not None:
        return False
    try:
        return budget(rig).output.buffered_hz is not None
    except (ConfigError, plugins.PluginError):
        return False
