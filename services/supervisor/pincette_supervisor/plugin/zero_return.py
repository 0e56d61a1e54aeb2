"""Force that is read when an arm, free again, returns to the position of its zero; pure."""

from math import hypot, sqrt

import numpy as np

from pincette.api.results import ZeroReturn
from pincette.config import RigFile, derived
from pincette.control.force.estimation import late_creep_um, uncertainty
from pincette.control.response.model_errors import passing
from pincette.core.faults import Phase
from pincette.records.columns import Columns
from pincette_supervisor.plugin.figures import series

UNMEASURED_RETURN = 3.0
"""Assumed ratio of return error to residual of a free response whose return error no calibration
has measured. On eight simulated arms (Bouc-Wen, relays) with calibrated models: 0.8 to 2.9."""


def zero_return_of(table: Columns, rig: RigFile) -> ZeroReturn | None:
    """Return the force at the position of the last zero before the contact, after the return.

    None if the job took no zero, held no part after it, or did not return free past that position.
    """
    x_um, force_mN, age_s = (series(table, name) for name in ("x_um", "force_mN", "zero_age_s"))
    held = np.array([bool(one) for one in table["held"]])
    zeros = np.flatnonzero(age_s < 0.5 * rig.rig.period_s)
    if not len(zeros) or not held[zeros[-1] :].any():
        return None
    place_um = float(x_um[zeros[-1]])
    back = (
        (np.arange(len(held)) > zeros[-1])
        & np.array([phase == Phase.RETREAT for phase in table["phase"]])
        & ~held
        & ~np.isnan(x_um + force_mN + age_s)
    )
    here = passing(x_um[back], place_um)
    if here is None:
        return None
    read_mN = force_mN[back][here]
    # The return shows whether a step was a slip or a jump of the sensor, so that doubt is left out.
    own_mN = series(table, "force_uncertainty_mN") - series(table, "force_doubt_mN")
    stated_mN = own_mN[back][here]
    uncertainty_mN = float(np.nanmean(stated_mN))
    free = rig.model.free_response
    if free is not None:
        return_um = free.return_error_um
        if return_um is None:
            return_um = UNMEASURED_RETURN * free.residual_um
        rest = derived.rest_samples(rig.rig.period_s)
        late_um = late_creep_um(
            percent_per_decade=free.creep_percent_per_decade,
            stroke_um=rig.model.piezo_um_per_V * float(np.nanmax(series(table, "voltage_V"))),
            age_s=float(age_s[back][here][-1]),
            known_to_s=derived.creep_known_s(rig.model),
        )
        uncertainty_mN = uncertainty(
            noise_um=rig.sensor.noise_um * sqrt(1.0 / len(read_mN) + 1.0 / rest),
            free_error_um=hypot(return_um, late_um),
            compliance_um_per_mN=rig.model.compliance_um_per_mN,
            creep_mN_per_decade=rig.model.creep_mN_per_decade,
            zero_age_s=float(age_s[back][here][-1]),
            forgotten_mN=0.0,
        )
    mean_mN = float(np.mean(read_mN))
    return ZeroReturn(
        force_mN=mean_mN,
        uncertainty_mN=uncertainty_mN,
        x_um=place_um,
        verified=abs(mean_mN) <= uncertainty_mN,
    )
