"""Parts of the simulated rig, each switched off by its defaults.

"Instruments" are the facts that the project has collected from manuals and literature; what they
do not state is marked as assumed.
"""

from pydantic import Field

from pincette.config.tables import NotNegative, Positive, Table


class Hysteresis(Table):
    """Bouc-Wen shape: dh/dt = A du/dt - b|du/dt|h - g du/dt|h|, y = d·u·(1 + κ·u) - h."""

    A_over_d: NotNegative
    """1; fitted to a ±150 V actuator, instruments: 0.34."""
    b_times_U: NotNegative
    """1; instruments: 1.04."""
    g_times_U: float
    """1; instruments: 0.26."""
    full_drive_V: Positive
    """V. U, the drive at which the shape is stated."""
    asymmetry: float = Field(default=0.0, gt=-1.0, lt=1.0)
    """1. b is b·(1 + asymmetry) while the voltage rises, b·(1 - asymmetry) while it falls;
    assumed, |b| of both ways must stay above |g|."""
    curvature_per_V: float = 0.0
    """1/V. κ, by which the gain d·(1 + 2·κ·u) grows with the voltage; assumed."""


class SecondMode(Table):
    """The second bending mode of the driven arm."""

    share: float = Field(default=0.0, ge=0.0, lt=1.0)
    """1. Share of the static deflection, by voltage or force; a cantilever loaded at its tip has
    (1.875/4.694)⁴ = 0.0255; 0: there is none."""
    frequency_ratio: float = Field(default=6.27, gt=1.0)
    """1, over the first mode's; instruments: near 6.27."""
    damping_ratio: Positive = 0.026
    """1, as the first mode's, assumed."""


class Amplifier(Table):
    """The amplifier between output and arm, all voltages counted at its input."""

    gain_ratio: Positive = 1.0
    """1. Gain over the nominal one (20); assumed."""
    saturation_V: Positive | None = None
    """V. EPA-104, instruments: ±200 V with a gain of 20, hence 10."""
    slew_V_per_s: Positive | None = None
    """V/s, assumed."""
    bandwidth_hz: Positive | None = None
    """Hz, -3 dB of a first-order lag; into the arm's capacitance, assumed."""


class Drift(Table):
    """Drift of the reading, slope·t + A·sin(2πt/T): of the room's heat between laser and gripper.

    It is a function of time, not a random walk, so that the reading at a time is the same however
    the time before was cut. All values are assumed.
    """

    slope_um_per_s: float = 0.0
    """µm/s, steady."""
    amplitude_um: NotNegative = 0.0
    """µm. A."""
    cycle_s: Positive = 600.0
    """s. T, the time of a room's air conditioning."""


class Bead(Table):
    """A ball of glass between the arms."""

    radius_um: Positive = 700.0
    """µm; paper: a bead of 1400 µm."""
    modulus_GPa: Positive | None = None
    """GPa. E* of each face; 37.95 makes 25 nm at 1 mN with R = 25 µm (instruments), and glass on
    glass has 37; None: rigid."""
    adhesion_J_per_m2: NotNegative = 0.0
    """J/m². w; instruments: 0.05-0.1."""
    roughness: float = Field(default=1.0, ge=0.0, le=1.0)
    """1. Pull-off force over its bound for smooth faces, 3/2·π·w·R; assumed."""
    density_kg_per_m3: Positive = 2500.0
    """kg/m³, of glass; 1400 µm then weigh 0.035 mN (instruments)."""
    friction: Positive | None = None
    """1. µ of the bead on each arm, assumed; None: it cannot fall."""
    lift_after_s: NotNegative | None = None
    """s. The part counts as lifted off the ground once the force has held its weight for so long,
    and falls when it does not any more; None: it stays on the ground."""
    break_force_mN: Positive | None = None
    """mN. The part breaks above; assumed."""
