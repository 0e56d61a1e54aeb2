"""The place that an arm goes back to after it has pressed a part.

Remanence keeps an arm above the place where it rested before, by 7 µm and more where relays are far
from saturation, and the reading of that place drifts. A way back to ``x_start_um`` could then need
a voltage below the limits, which ends as a following error.
"""

from pincette.control.planning.planned_arm import PlannedArm

HOME_SHARE = 0.5
"""Share of the voltages below 0 V that the way back may need; the rest is for errors of the model,
and for drift that no reading has shown."""


def home_um(
    arm: PlannedArm,
    furthest_um: float,
    highest_mN: float,
    *,
    stand_off_um: float,
    voltage_min_V: float,
    rest_um: float | None = None,
) -> float:
    """Return ``x_start_um`` where the arm surely reaches it, else where the arm rests at 0 V.

    Parameters
    ----------
    furthest_um, highest_mN
        Furthest position and highest force of the plan.
    stand_off_um
        Position in front of the part beyond which home never lies.
    voltage_min_V
        Lower limit of the voltage.
    rest_um
        Reading of the arm at rest at 0 V as the plan begins; None: not known.
    """
    low_V = min(0.0, HOME_SHARE * voltage_min_V)
    at_rest_um, lowest_um = arm.way_back_um(furthest_um, highest_mN, (0.0, low_V))
    reach_um = at_rest_um - lowest_um
    if rest_um is not None:
        at_rest_um = max(at_rest_um, rest_um)
    if at_rest_um - reach_um <= arm.x_start_um:
        return arm.x_start_um
    return max(arm.x_start_um, min(at_rest_um, stand_off_um))
