"""What a lane remembers between ticks, and how it may end."""

from enum import IntEnum
from typing import Any

import numpy as np

# A record of an array, whose fields a compiler knows and a type checker does not.
LaneRecord = Any


class Ending(IntEnum):
    """Why a lane does not go on."""

    NONE = 0
    """It goes on."""
    DONE = 1
    """Its program has come to its end."""
    ZERO = 2
    """The estimator is asked for a zero, and answers outside."""
    OVERFORCE = 3
    NO_CONTACT = 4
    LOST = 5
    NO_LINE = 6
    """The contact line could not be fitted, or is too stiff or too soft."""
    LIMIT = 7
    """A hard limit of force, position or following error."""
    BLIND = 8
    """A reading that is no measurement, or a sensor that is stuck."""
    ABSURD = 9
    """The law has asked for no voltage."""
    TOO_LONG = 10
    """The program has not come to its end in the ticks that were planned for it."""
    ZERO_REFUSED = 11
    OTHERWISE = 12
    """Played by the composed loop, to another end than its program's; see ``Run.outcome``."""
    CONTACT = 13
    """Something may have been met on the way through free space."""


X, FORCE, APPLIED, TRUE_X, TRUE_FORCE, VOLTAGE, X_R, FORCE_R = range(8)
X_D, SLIDING, BAND, RESIDUAL, PERTURBATION_ERROR, SEGMENT, STIFFNESS = range(8, 15)
COLUMNS = (
    "x_um",
    "force_mN",
    "applied_V",
    "true_x_um",
    "true_force_mN",
    "voltage_V",
    "x_r_um",
    "force_r_mN",
    "x_d_um",
    "sliding_um",
    "band_um",
    "residual_um",
    "perturbation_error_mN",
    "segment",
    "stiffness_mN_per_um",
)
"""What is kept of each tick; see ``Estimate``, ``Telemetry``, ``Applied`` and ``Truth``.

``segment`` is its place in the program, ``stiffness_mN_per_um`` 0 before the contact.
"""

LANE = np.dtype(
    [
        (name, kind)
        for kind, names in {
            "i8": "tick ending index ticks count equal line_count force_over following_over "
            "position_over limits_active",
            "?": "pressing zeroing zeroed held bump ended steered aimed zero known_contact sensed",
            "f8": "x_um force_mN voltage_V static_um followed_V offset_um zero_s "
            "x_r_um speed_um_per_s force_r_mN from_x_um from_speed_um_per_s from_force_mN "
            "contact_x_um stiffness_mN_per_um aim_um true_x_um true_force_mN "
            "x_d_um law_force_r_mN law_force_error_mN",
        }.items()
        for name in names.split()
    ],
    align=True,
)
"""Names as in the controller's ``Player``, the estimator's ``State`` and the safety ``Watches``."""
