"""Stiffness and place of a contact out of a press at several levels of voltage."""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.calibration.contact_stiffness import Swing, contact_stiffness
from pincette.control.calibration.first_touch import first_touch
from pincette.control.planning.calibration_programs import full_cycles
from pincette.control.planning.contact_stiffness_program import LEVEL_CYCLES, level_phase
from pincette_supervisor.analysis.findings import (
    Analysis,
    ContactFound,
    figure,
    identified,
    path_of,
    residuals,
    sure,
)
from pincette_supervisor.analysis.samples import Samples
from pincette_supervisor.planning.planned import Planned

EARLY_PRESS = 3.0
"""Force, as a multiple of the contact force, up to which a press belongs to the first touch."""


def contact(planned: Planned, taken: Samples) -> Analysis:
    """Analyse a press; raises ValueError where the contact was lost, or none was met."""
    rig, values = planned.model.rig, planned.values
    s_p, free = rig.model.compliance_um_per_mN, rig.model.free_response
    swings: list[Swing] = []
    samples_per_cycle = 0.0
    for number, level_V in enumerate(values["levels_V"], start=1):
        path, begin = path_of(planned, level_phase(number)), taken.of(level_phase(number)).start
        whole = full_cycles(path, taken.period_s, LEVEL_CYCLES)
        place = slice(begin + whole.start, begin + whole.stop)
        what = f"level of {level_V:g} V"
        x_um = taken.filled(taken.x_um, place, what)
        force_mN = taken.filled(taken.force_mN, place, what)
        if free is not None:
            force_mN = _judged(x_um, force_mN, s_p, free.press_gain)
        swings.append(Swing(level_V, x_um, force_mN))
        samples_per_cycle = path.cycle_s / taken.period_s
    found = contact_stiffness(
        swings,
        samples_per_cycle,
        compliance_um_per_mN=s_p,
        compliance_uncertainty_um_per_mN=(
            planned.model.uncertainties.get("model.compliance_um_per_mN") or 0.0
        ),
        free_error_um=0.0 if free is None else sqrt(2.0) * free.residual_um,
    )
    touch = first_touch(*_approach(taken, EARLY_PRESS * values["contact_force_mN"]), s_p)
    K_e, u = found.stiffness_mN_per_um, found.uncertainty_mN_per_um
    left = [level.residual_mN for level in found.levels]
    return Analysis(
        values=(
            identified("part.stiffness_mN_per_um", K_e, u),
            identified("part.contact_um", touch.contact_um, touch.uncertainty_um),
        ),
        figures=(
            figure("offset", found.line.offset, "mN", "of the line of Fig. 8, at 0 µm"),
            figure(
                "scatter",
                found.scatter_mN_per_um,
                "mN/µm",
                "part of the uncertainty that the residuals show",
            ),
            figure(
                "first touch stiffness",
                touch.stiffness_mN_per_um,
                "mN/µm",
                "by the few µm after the touch, far less sure",
            ),
        ),
        residuals=residuals("force, peak to peak", "mN", left),
        statement=sure(
            K_e, u, "mN/µm", "of the scatter, of the compliance and of the free response as stated"
        ),
        drawn=ContactFound(found, touch),
    )


def _judged(
    x_um: NDArray[np.float64], force_mN: NDArray[np.float64], s_p: float, press_gain: float
) -> NDArray[np.float64]:
    """The force with the swings of x_1 as large as they were measured: x_1 = x + s_p·F̂."""
    x_1_um = x_um + s_p * force_mN
    more_um = (press_gain - 1.0) * (x_1_um - np.mean(x_1_um))
    return force_mN + more_um / s_p


def _approach(taken: Samples, up_to_mN: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions and forces of the seek and of the press as long as it is light."""
    seek, press = taken.of("contact"), taken.of("press")
    place = slice(seek.start, press.stop)
    x_um = taken.filled(taken.x_um, place, "approach")
    force_mN = taken.filled(taken.force_mN, place, "approach")
    beyond = np.flatnonzero(force_mN > up_to_mN)
    end = int(beyond[0]) if len(beyond) else len(x_um)
    return x_um[:end], force_mN[:end]
