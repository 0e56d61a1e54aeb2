"""The simulated rig and its parts; the default of each value switches its effect off.

"Instruments" are the facts that the project has collected from manuals and literature; values that
these do not state are marked as assumed.
"""

from typing import Self

from pydantic import Field, model_validator

from pincette.config.script import ScriptedOrder
from pincette.config.tables import NotNegative, Positive, Table


class Hysteresis(Table):
    """Bouc-Wen shape: dh/dt = A du/dt - b|du/dt|h - g du/dt|h|, y = d·u·(1 + κ·u) - h."""

    A_over_d: NotNegative
    """1. Ratio A/d; fitted to a ±150 V actuator, instruments: 0.34."""
    b_times_U: NotNegative
    """1. Product b·U; instruments: 1.04."""
    g_times_U: float
    """1. Product g·U; instruments: 0.26."""
    full_drive_V: Positive
    """Drive U at which the shape is stated."""
    asymmetry: float = Field(default=0.0, gt=-1.0, lt=1.0)
    """1. Asymmetry of b: b·(1 + asymmetry) while the voltage rises, b·(1 - asymmetry) while it
    falls; assumed, |b| in both directions must stay above |g|."""
    curvature_per_V: float = 0.0
    """Curvature κ, by which the gain d·(1 + 2·κ·u) grows with the voltage; assumed."""


class Relays(Table):
    """Relays after Preisach: y = d·((1 - ρ)·u + ρ·P(u)) + d·κ·u², P with memory of past extremes.

    It replaces ``[simulation.hysteresis]`` by another class of hysteresis. Small loops close on
    themselves, and a past extreme is forgotten only when a larger swing passes it.
    """

    loop_share: float = Field(ge=0.0, lt=1.0)
    """1. Width of the loop between -U and U over its stroke, without creep; sets ρ."""
    full_drive_V: Positive
    """Drive U at which the loop is stated."""
    coercive_share: Positive = 1.0
    """1. Voltage, as a share of U, near which relays rise, and near minus which they fall; fitted
    to a measured stack: 1.1-1.7."""
    spread_share: Positive = 1.5
    """1. Spread of both voltages, as a share of U, at least a fifth of coercive_share; for the same
    stack, 1.4 and more: an actuator in its range is far from saturation."""
    centre_V: float = 0.0
    """Voltage about which the thresholds lie; it makes the loop asymmetric; for the same stack,
    the middle of its range."""
    curvature_per_V: float = 0.0
    """Curvature κ, by which the gain grows with the voltage."""


class SecondMode(Table):
    """The second bending mode of the driven arm."""

    share: float = Field(default=0.0, ge=0.0, lt=1.0)
    """1. Share of the static deflection, by voltage or force; a cantilever loaded at its tip has
    (1.875/4.694)⁴ = 0.0255; 0: there is no second mode."""
    frequency_ratio: float = Field(default=6.27, gt=1.0)
    """1. Ratio of its frequency to that of the first mode; instruments: near 6.27."""
    damping_ratio: Positive = 0.026
    """1. Damping ratio of the mode; assumed equal to that of the first mode."""


class Amplifier(Table):
    """The amplifier between output and arm; all voltages are those at its input."""

    gain_ratio: Positive = 1.0
    """1. Ratio of the gain to the nominal one (20); assumed."""
    saturation_V: Positive | None = None
    """Saturation voltage. EPA-104, instruments: ±200 V with a gain of 20, hence 10."""
    slew_V_per_s: Positive | None = None
    """Slew limit; assumed."""
    bandwidth_hz: Positive | None = None
    """Bandwidth, -3 dB of a first-order lag into the arm's capacitance; assumed."""


class Drift(Table):
    """Drift of the reading, slope·t + A·sin(2πt/T), from the room's heat between laser and gripper.

    It is a function of time, not a random walk, so that the reading at a time does not depend on
    how the time before was divided. All values are assumed.
    """

    slope_um_per_s: float = 0.0
    """Steady slope of the drift."""
    amplitude_um: NotNegative = 0.0
    """Amplitude A of the cycle."""
    cycle_s: Positive = 600.0
    """Period T of the room's air conditioning."""


class Bead(Table):
    """A ball of glass between the arms."""

    radius_um: Positive = 700.0
    """Radius of the bead; paper: a bead of 1400 µm."""
    modulus_GPa: Positive | None = None
    """Effective modulus E* of each face; 37.95 makes 25 nm at 1 mN with R = 25 µm
    (instruments), and glass on glass has 37; None: rigid."""
    adhesion_J_per_m2: NotNegative = 0.0
    """Work of adhesion w; instruments: 0.05-0.1."""
    roughness: float = Field(default=1.0, ge=0.0, le=1.0)
    """1. Ratio of the pull-off force to its bound for smooth faces, 3/2·π·w·R; assumed."""
    liquid_um3: NotNegative = 0.0
    """Liquid between arm and bead, which forms a bridge at the first touch; 1000 µm³ are 1 pL;
    assumed."""
    surface_tension_J_per_m2: Positive = 0.072
    """Surface tension γ of the liquid; water: 0.072."""
    wetting: float = Field(default=1.0, gt=0.0, le=1.0)
    """1. Cosine of the contact angle of the liquid."""
    ageing_per_decade: NotNegative = 0.0
    """1. Share by which the pull-off force grows with each decade of the contact time; assumed."""
    bond_mN: NotNegative = 0.0
    """Pull that residue or glue between arm and bead withstands for 1 s; 0: there is none;
    assumed."""
    bond_scale_mN: Positive = 1.0
    """Pull that shortens the life of the bond by the factor e; assumed."""
    density_kg_per_m3: Positive = 2500.0
    """Density of glass; 1400 µm then weigh 0.035 mN (instruments)."""
    friction: Positive | None = None
    """1. Coefficient of friction µ of the bead on each arm; assumed; None: it cannot fall."""
    lift_after_s: NotNegative | None = None
    """Time for which the force must have held the part's weight until the part counts as lifted
    off the ground; it falls when the force no longer holds it; None: it stays on the ground."""
    break_force_mN: Positive | None = None
    """Force above which the part breaks; assumed."""
    slip_force_mN: Positive | None = None
    """Force above which the face of the part gives way by ``slip_um``; None: it does not."""
    slip_um: Positive = 1.0
    """Distance by which the face gives way at once."""
    slips: int = Field(default=1, ge=1)
    """1. Number of times that the face gives way."""


class SecondArm(Table):
    """The second arm of a simulated rig; values that are left out are those of the first arm."""

    natural_frequency_rad_per_s: Positive | None = None
    """Undamped natural frequency."""
    damping_ratio: Positive | None = None
    """1. Damping ratio."""
    compliance_um_per_mN: Positive | None = None
    """Compliance s_p."""
    piezo_um_per_V: Positive | None = None
    """Free stroke per volt at the amplifier's input."""
    hysteresis: Hysteresis | None = None
    """Hysteresis of the arm's free motion; only one of this table and ``relays`` is allowed."""
    relays: Relays | None = None
    """Relay hysteresis of the arm's free motion, if it is of another class than the first arm's."""
    creep_per_decade: NotNegative | None = None
    """1. Creep per decade of time after a step."""
    sensor_noise_um: NotNegative | None = None
    """Noise of the sensor, r.m.s., white, and independent of the first sensor's."""
    sensor_step_um: Positive | None = None
    """Resolution of the reading."""
    drift: Drift | None = None
    """Drift of the reading."""
    output_step_V: Positive | None = None
    """Resolution of the voltage output."""
    output_lag_s: NotNegative | None = None
    """Time constant of a first-order lag of the voltage output."""
    amplifier: Amplifier | None = None
    """Amplifier between output and arm."""
    bead_contact_um: float | None = None
    """Position of this arm's tip at which it touches the part at its initial place."""

    @model_validator(mode="after")
    def _one_class(self) -> Self:
        if self.hysteresis is not None and self.relays is not None:
            raise ValueError(
                "both [simulation.second.hysteresis] and [simulation.second.relays] given: the "
                "simulated arm has one class of hysteresis; give one of the tables"
            )
        return self


class PairOfArms(Table):
    """Properties of what lies between the two arms of a simulated rig, besides the part."""

    face_mN_per_um: Positive = 80.0
    """Stiffness of the part's face at each arm; two of 80 yield as one spring of 40."""
    ground_mN_per_um: Positive = 5.0
    """Stiffness with which the part sticks to its place; assumed."""
    ground_slip_mN: NotNegative = 0.0
    """Force above which the part slips on the ground; 0: it lies loose."""
    pull_off_mN: tuple[NotNegative, NotNegative] = Field(default=(0.0, 0.0), strict=False)
    """Forces at which the part comes off the first arm and off the second."""
    lands: bool = False
    """True if a lifted part that is released returns to its old place on the ground, as on a stage
    that has followed it; otherwise it falls and is gone."""


class Simulation(Table):
    """The simulated rig: the true plant, which no other program may read.

    The default of each value switches its effect off.
    """

    seed: int = Field(default=1, ge=0)
    """Seed of the sensor's noise."""
    substep_s: Positive = 0.001
    """Longest step of the plant. Within it the motion is exact for an input that settles
    exponentially. A plain arm (one mode against a part without mass) has a constant input within
    it, so that a lag of the output leaves more ring than a finer step shows."""
    natural_frequency_rad_per_s: Positive
    """Undamped natural frequency of the free driven arm's first mode; paper (54): 2437.8."""
    damping_ratio: Positive
    """1. Damping ratio of that mode; paper (54): 0.026."""
    second_mode: SecondMode = SecondMode()
    """Second mode; by default the arm has one mode."""
    compliance_um_per_mN: Positive
    """Compliance s_p of the driven arm's tip, all modes together; paper (55): 0.46."""
    piezo_um_per_V: Positive
    """Gain d of y = d·u·(1 + κ·u) - h, at the amplifier's input."""
    hysteresis: Hysteresis | None = None
    """Hysteresis of the arm's free motion; exactly one of this table and ``relays`` is required."""
    relays: Relays | None = None
    """Relay hysteresis of the arm's free motion, in place of ``hysteresis``."""
    creep_per_decade: NotNegative
    """1. Creep per decade of time after a step; 0.01-0.02 according to the literature."""
    sensor_noise_um: NotNegative
    """Noise of the sensor, r.m.s., white; 0.015-0.05 for a laser at this resolution."""
    sensor_step_um: Positive
    """Resolution of the reading; paper section VI.A: 0.025."""
    averaging_s: NotNegative = 0.0
    """Time over which the reading averages the position; the LK-G5000 averages up to 4^i
    samples."""
    drift: Drift = Drift()
    """Drift of the reading."""
    output_step_V: Positive | None = None
    """Resolution of the voltage output; None: that of the driver's instrument."""
    output_lag_s: NotNegative | None = None
    """Time constant of a first-order lag of the voltage output; None: that of the driver's
    instrument."""
    amplifier: Amplifier = Amplifier()
    """Amplifier; by default the voltage at the arm is that of the output."""
    actuation_delay_s: NotNegative
    """Lockstep: time from the sample to the arrival of the voltage."""
    pace: NotNegative = 0.0
    """1. Lockstep: highest speed as a multiple of real time; 0: as fast as the programs can."""
    bead: bool = True
    """True if a part is present at the start."""
    bead_contact_um: float
    """Position of the driven arm's tip at the first touch, with the passive arm at rest."""
    environment_stiffness_mN_per_um: Positive
    """Stiffness of the passive arm; instruments: about 2.17."""
    passive_natural_frequency_rad_per_s: Positive | None = None
    """Natural frequency of the passive arm alone; instruments: also 388 Hz. None: an arm
    without mass."""
    passive_damping_ratio: Positive = 0.026
    """1. Damping ratio of the passive arm alone; assumed equal to the driven arm's."""
    part: Bead = Bead()
    """The part."""
    second: SecondArm | None = None
    """The second arm of a rig with ``[second]``; by default equal to the first."""
    pair: PairOfArms | None = None
    """Properties of what lies between the two arms."""
    baud: int = Field(default=115200, ge=1200)
    """Baud rate of the simulated serial lines, where the driver's options state none."""
    truth: bool = True
    """True publishes the true position and force, for records and comparison."""
    scripts: bool = False
    """True accepts commands of `pincette rig`."""
    script: tuple[ScriptedOrder, ...] = Field(default=(), strict=False)
    """Commands that run at their times."""

    @model_validator(mode="after")
    def _one_class(self) -> Self:
        if (self.hysteresis is None) == (self.relays is None):
            many = "neither" if self.relays is None else "both"
            raise ValueError(
                f"{many} of [simulation.hysteresis] and [simulation.relays] given: the simulated "
                "arm has one class of hysteresis; give one of the tables"
            )
        return self

    @property
    def arms(self) -> tuple["Simulation", "Simulation"]:
        """Return the simulation of each of two arms, as if it were the only one."""
        first = self.model_copy(update={"second": None, "pair": None})
        if self.second is None:
            return first, first
        update = {name: getattr(self.second, name) for name in type(self.second).model_fields}
        given = {name: value for name, value in update.items() if value is not None}
        if given.keys() & {"hysteresis", "relays"}:
            given = {"hysteresis": None, "relays": None} | given
        return first, first.model_copy(update=given)

    @property
    def pair_of_arms(self) -> PairOfArms:
        """Return the properties of what lies between two arms."""
        return self.pair or PairOfArms()

    @property
    def bouc_wen(self) -> Hysteresis:
        """Return the shape of a rig with Bouc-Wen hysteresis.

        Raises ValueError for another class.
        """
        if self.hysteresis is None:
            raise ValueError(
                "the simulated arm has relays: give [simulation.hysteresis] instead of "
                "[simulation.relays]"
            )
        return self.hysteresis
