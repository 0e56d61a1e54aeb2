"""What a job does where its request says nothing else."""

from pydantic import Field

from pincette.config.tables import Positive, Table
from pincette.control.planning.paths import Shape


class Grip(Table):
    """Defaults of a grip job; a request may replace each."""

    force_mN: Positive = 20.0
    """Held, compressive."""
    hold_s: Positive = 4.0
    """How long it is held."""
    load_s: Positive = 2.0
    """From the touch to the force, and as long back."""
    approach_um_per_s: Positive = 20.0
    """Speed to just before the contact."""
    seek_um_per_s: Positive = 4.0
    """Speed from there until the part is touched."""
    contact_force_mN: Positive = 2.0
    """Estimated force that counts as touch."""
    zero_s: Positive = 0.4
    """At rest, before the arm moves: the force estimate is set to zero."""


class Track(Table):
    """Defaults of a track job; a request may replace each. What is not here is as in a grip."""

    shape: Shape = "sinusoid"
    """Of the path."""
    force_mean_mN: Positive = 12.0
    """Middle of a sinusoid or triangle."""
    force_pp_mN: Positive = 20.0
    """Its height, peak to peak."""
    frequency_hz: Positive = 0.5
    """Of a sinusoid or triangle."""
    cycles: int = Field(default=5, ge=1, le=1000)
    """At full amplitude; one more before and one after blend in and out."""
    levels_mN: tuple[Positive, ...] = Field(
        default=(5.0, 10.0, 15.0, 20.0), min_length=1, max_length=100, strict=False
    )
    """Of steps, in their order."""
    dwell_s: Positive = 2.0
    """At each level."""
    rate_um_per_s: Positive = 60.0
    """Highest speed of x_r along a path; steps use it up."""
    acceleration_um_per_s2: Positive = 2000.0
    """Highest acceleration of x_r along a path; steps and corners use it up."""
