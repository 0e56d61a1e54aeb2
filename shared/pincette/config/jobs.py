"""Defaults of jobs, which a request may replace."""

from typing import Literal

from pydantic import Field

from pincette.config.tables import Positive, Table
from pincette.control.planning.paths import Shape


class QuickGrip(Table):
    """Largest speeds of a quick grip.

    The force, the period and the slew limit may require lower speeds.

    A request may replace the first three.
    """

    approach_um_per_s: Positive = 120.0
    """Peak speed of the free arm on its way to the part and back."""
    seek_um_per_s: Positive = 40.0
    """Speed at which the arm contacts the part and the load begins."""
    load_um_per_s: Positive = 40.0
    """Peak speed while the part is loaded and unloaded."""
    zero_s: Positive = 0.3
    """Time at rest during which the force estimate is zeroed; at least 10 periods."""


Condition = Literal["auto", "always", "never"]


class Grip(Table):
    """Defaults of a grip job; a request may replace each.

    The three speeds apply to a gentle grip and to other jobs.
    """

    profile: Literal["quick", "gentle"] | None = None
    """Profile of the motion. ``quick``: the load begins at contact without a stop, and uses the
    contact line as it is identified; ``gentle``: the arm stops at contact, and the line is
    identified during the load. None: quick if the free response is identified and the force is
    large enough.
    """
    force_mN: Positive = 20.0
    """Force of the hold; compressive forces are positive."""
    hold_s: Positive = 4.0
    """Duration of the hold."""
    load_s: Positive = 2.0
    """Time from contact to the requested force; unloading takes as long."""
    approach_um_per_s: Positive = 20.0
    """Speed of the approach, until just before contact."""
    seek_um_per_s: Positive = 4.0
    """Speed from just before contact until contact."""
    contact_force_mN: Positive = 2.0
    """Estimated force from which on contact is reported."""
    zero_s: Positive = 0.4
    """Time at rest, before the arm moves, during which the force estimate is zeroed; at least 10
    periods.
    """
    condition: Condition = "auto"
    """Use of conditioning strokes to the lowest identified voltage at the beginning of a grip or a
    path. They bring the hysteresis of the arm to a known state and compare its stroke with that of
    the calibration. ``auto``: if the model in use allows them. ``always``: a plan is refused if it
    does not. ``never``: without them, earlier motion may cause force errors of several mN.
    """
    quick: QuickGrip = QuickGrip()
    """Speeds of a quick grip."""


class Track(Table):
    """Defaults of a track job; a request may replace each. Other defaults are those of a grip."""

    shape: Shape = "sinusoid"
    """Shape of the path."""
    force_mean_mN: Positive = 12.0
    """Mean force of a sinusoid or triangle."""
    force_pp_mN: Positive = 20.0
    """Peak-to-peak force of a sinusoid or triangle."""
    frequency_hz: Positive = 0.5
    """Frequency of a sinusoid or triangle."""
    cycles: int = Field(default=5, ge=1, le=1000)
    """Number of cycles at full amplitude. One more cycle before and one after them change the
    amplitude smoothly.
    """
    levels_mN: tuple[Positive, ...] = Field(
        default=(5.0, 10.0, 15.0, 20.0), min_length=1, max_length=100, strict=False
    )
    """Forces of the steps, in order."""
    dwell_s: Positive = 2.0
    """Time at each level."""
    rate_um_per_s: Positive = 60.0
    """Highest speed of x_r along a path; steps use it fully."""
    acceleration_um_per_s2: Positive = 2000.0
    """Highest acceleration of x_r along a path; steps and corners use it fully."""
