"""What a lane works with and does not change, of the rig, of its instruments and of the program."""

from typing import Any, NamedTuple

import numpy as np

from pincette.control.response.play_operators import Floats, Plays
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.voltage import VoltageLimits
from pincette.sim.plant.drive import DriveConstants

# Floats in rows, whether a list or an array keeps them.
Rows = Any


class Stretch(NamedTuple):
    """Substeps of one length in a row."""

    drive: DriveConstants
    arms: Any
    """``PlainConstants`` or ``MotionConstants``; which, a kernel knows."""
    substeps: int


class Bench(NamedTuple):
    """The simulated rig behind its instruments."""

    before: Stretch
    """Until the voltage arrives: whole substeps, and"""
    before_rest: Stretch
    """what is left of them."""
    after: Stretch
    after_rest: Stretch
    first_touch_um: float
    there: bool
    """Whether there is a part to touch."""
    stiffness_mN_per_um: float
    output_step_V: float
    sensor_noise_um: float
    sensor_step_um: float
    um_per_unit: float
    counts_per_unit: float
    direction: int
    offset_um: float
    minimum_um: float
    maximum_um: float


class Observer(NamedTuple):
    """The estimator's model of the free response, and its force (53)."""

    model: Plays
    compliance_um_per_mN: float
    stuck_V: float


class Inverse(NamedTuple):
    """How the law takes the free response; see ``law.FreeResponseInput``."""

    inverts: bool
    """Whether it stands in place of the line."""
    um_per_V: float


SEGMENT = np.dtype(
    [
        ("kind", "i8"),
        ("path", "i8"),
        ("duration_s", "f8"),
        ("x_to_um", "f8"),
        ("force_to_mN", "f8"),
        ("move_s", "f8"),
        ("presses", "?"),
        ("loads", "?"),
        ("watched", "?"),
        ("holds", "?"),
    ],
    align=True,
)
"""A segment of a program. ``path``: where its path begins in ``Play.values`` and ``rates``; -1
without one. ``watched``: whether a part can be lost in it; ``holds``: whether at any force."""
# An array of records, whose fields a compiler knows and a type checker does not.
Segments = Any


class Play(NamedTuple):
    """The program with its guards, and the limits that hold whatever it asks for."""

    segments: Segments
    values: Floats
    rates: Floats
    """Of the paths, a point a tick."""
    period_s: float
    planned_mN_per_um: float
    identifies: bool
    """Whether the contact line is taken from the load."""
    contact_force_mN: float
    contact_samples: int
    force_max_mN: float
    lost_fraction: float
    lost_samples: int
    stiffness_min_mN_per_um: float
    stiffness_max_mN_per_um: float
    voltage: VoltageLimits
    monitors: MonitorLimits
    least_V: float
    """What the law may ask for, however far the limits cut it:"""
    most_V: float
    """beyond, a voltage is absurd."""
