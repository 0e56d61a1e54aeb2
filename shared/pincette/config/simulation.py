"""The simulated rig and its components; the default of each value switches its effect off.

"Instruments" refers to facts collected from manuals and literature; values not stated there are
marked as assumed.
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
    """Drive U for which the shape is stated."""
    asymmetry: float = Field(default=0.0, gt=-1.0, lt=1.0)
    """1. Asymmetry of b: b·(1 + asymmetry) while the voltage rises, b·(1 - asymmetry) while it
    falls; assumed. In both directions |b| must be larger than |g|.
    """
    curvature_per_V: float = 0.0
    """Curvature κ; the gain d·(1 + 2·κ·u) increases with the voltage; assumed."""


class Relays(Table):
    """Preisach relays: y = d·((1 - ρ)·u + ρ·P(u)) + d·κ·u², where P depends on past extremes.

    This table replaces ``[simulation.hysteresis]`` by another class of hysteresis. Small loops are
    closed, and a past extreme loses its effect only when the voltage passes it.
    """

    loop_share: float = Field(ge=0.0, lt=1.0)
    """1. Width of the loop between -U and U divided by its stroke, without creep; it determines
    ρ.
    """
    full_drive_V: Positive
    """Drive U for which the loop is stated."""
    coercive_share: Positive = 1.0
    """1. Voltage, as a fraction of U, near which relays switch on; they switch off near its
    negative. Fitted to a measured stack: 1.1-1.7.
    """
    spread_share: Positive = 1.5
    """1. Spread of both switching voltages, as a fraction of U, at least a fifth of coercive_share;
    for the measured stack of ``coercive_share`` 1.4 and more, since an actuator in its range is far
    from saturation."""
    centre_V: float = 0.0
    """Voltage about which the thresholds are centred; it makes the loop asymmetric; for the
    measured stack, the middle of its range."""
    curvature_per_V: float = 0.0
    """Curvature κ; the gain increases with the voltage."""


class SecondMode(Table):
    """The second bending mode of the driven arm."""

    share: float = Field(default=0.0, ge=0.0, lt=1.0)
    """1. Share of the static deflection, by voltage or by force, due to this mode; a cantilever
    loaded at its tip has (1.875/4.694)⁴ = 0.0255; 0: there is no second mode.
    """
    frequency_ratio: float = Field(default=6.27, gt=1.0)
    """1. Ratio of the frequency of the second mode to that of the first mode; instruments: near
    6.27."""
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
    """Drift of the reading, slope·t + A·sin(2πt/T), due to the room temperature between laser and
    gripper.

    It is a function of time, not a random walk, so the reading does not depend on the time steps
    before it. All values are assumed.
    """

    slope_um_per_s: float = 0.0
    """Steady slope of the drift."""
    amplitude_um: NotNegative = 0.0
    """Amplitude A of the cyclic drift."""
    cycle_s: Positive = 600.0
    """Period T of the cyclic drift, caused by the room's air conditioning."""


class Bead(Table):
    """A ball of glass between the arms."""

    radius_um: Positive = 700.0
    """Radius of the bead; the paper's bead has a diameter of 1400 µm."""
    modulus_GPa: Positive | None = None
    """Effective modulus E* of each face. 37.95 gives 25 nm at 1 mN with R = 25 µm (instruments);
    glass on glass has 37. None: rigid.
    """
    adhesion_J_per_m2: NotNegative = 0.0
    """Work of adhesion w; typical values (instruments): 0.05-0.1."""
    roughness: float = Field(default=1.0, ge=0.0, le=1.0)
    """1. Ratio of the pull-off force to its upper bound for smooth faces, 3/2·π·w·R; assumed."""
    liquid_um3: NotNegative = 0.0
    """Liquid between arm and bead, which forms a bridge at first contact; 1000 µm³ are 1 pL;
    assumed.
    """
    surface_tension_J_per_m2: Positive = 0.072
    """Surface tension γ of the liquid; water: 0.072."""
    wetting: float = Field(default=1.0, gt=0.0, le=1.0)
    """1. Cosine of the contact angle of the liquid."""
    ageing_per_decade: NotNegative = 0.0
    """1. Relative increase of the pull-off force per decade of the contact time; assumed."""
    bond_mN: NotNegative = 0.0
    """Pull that residue or glue between arm and bead withstands for 1 s; 0: no bond; assumed."""
    bond_scale_mN: Positive = 1.0
    """Additional pull that shortens the life of the bond by the factor e; assumed."""
    density_kg_per_m3: Positive = 2500.0
    """Density of glass; a bead with a diameter of 1400 µm then weighs 0.035 mN (instruments)."""
    friction: Positive | None = None
    """1. Coefficient of friction µ of the bead on each arm; assumed; None: the bead cannot fall."""
    lift_after_s: NotNegative | None = None
    """Time for which the force must be able to hold the part's weight until the part counts as
    lifted off the ground. A lifted part falls when the force becomes too small. None: the part
    stays on the ground.
    """
    break_force_mN: Positive | None = None
    """Force above which the part breaks; assumed."""
    slip_force_mN: Positive | None = None
    """Force above which the face of the part slips by ``slip_um``; None: it does not slip."""
    slip_um: Positive = 1.0
    """Distance by which the face slips at once."""
    slips: int = Field(default=1, ge=1)
    """1. Number of times that the face slips."""


class SecondArm(Table):
    """The second arm of a simulated rig; omitted values are those of the first arm."""

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
    """Relay hysteresis of the arm's free motion, if its class differs from that of the first
    arm.
    """
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
    """Position of this arm's tip at which it contacts the part in its initial place."""

    @model_validator(mode="after")
    def _one_class(self) -> Self:
        if self.hysteresis is not None and self.relays is not None:
            raise ValueError(
                "both [simulation.second.hysteresis] and [simulation.second.relays] given: the "
                "simulated arm has one class of hysteresis; give one of the tables"
            )
        return self


class PairOfArms(Table):
    """Properties of the contact faces and the ground between the two arms of a simulated rig."""

    face_mN_per_um: Positive = 80.0
    """Stiffness of the part's face at each arm; two of 80 in series act as one spring of 40."""
    ground_mN_per_um: Positive = 5.0
    """Stiffness with which the ground holds the part in its place; assumed."""
    ground_slip_mN: NotNegative = 0.0
    """Force above which the part slips on the ground; 0: the ground does not hold it."""
    pull_off_mN: tuple[NotNegative, NotNegative] = Field(default=(0.0, 0.0), strict=False)
    """Forces at which the part comes off the first and the second arm."""
    lands: bool = False
    """True if a lifted part that is released returns to its old place on the ground, as on a stage
    that has followed it; otherwise it falls and is lost.
    """


class Simulation(Table):
    """The simulated rig: the true plant, which no other program may read.

    The default of each value switches its effect off.
    """

    seed: int = Field(default=1, ge=0)
    """Seed of the sensor's noise."""
    substep_s: Positive = 0.001
    """Longest time step of the plant. Within a step, the motion is computed exactly for an
    exponentially settling input. For a simple arm (one mode, a part without mass) the input is
    constant within a step; with an output lag this causes more ringing than a smaller step would.
    """
    natural_frequency_rad_per_s: Positive
    """Undamped natural frequency of the free driven arm's first mode; paper (54): 2437.8."""
    damping_ratio: Positive
    """1. Damping ratio of the free driven arm's first mode; paper (54): 0.026."""
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
    """Time over which the sensor averages the position; the LK-G5000 averages up to 4^i samples."""
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
    """Delay from the sample to the arrival of the voltage; for lockstep."""
    pace: NotNegative = 0.0
    """1. Highest speed as a multiple of real time, for lockstep; 0: no limit."""
    bead: bool = True
    """True if a part is present at the start."""
    bead_contact_um: float
    """Position of the driven arm's tip at first contact, with the passive arm at rest."""
    environment_stiffness_mN_per_um: Positive
    """Stiffness of the passive arm; instruments: about 2.17."""
    passive_natural_frequency_rad_per_s: Positive | None = None
    """Natural frequency of the passive arm alone; instruments: 388 Hz, as the driven arm. None: an
    arm without mass.
    """
    passive_damping_ratio: Positive = 0.026
    """1. Damping ratio of the passive arm alone; assumed equal to the driven arm's."""
    part: Bead = Bead()
    """The part."""
    second: SecondArm | None = None
    """The second arm of a rig with ``[second]``; by default equal to the first."""
    pair: PairOfArms | None = None
    """Properties of the contact faces and the ground between the two arms."""
    baud: int = Field(default=115200, ge=1200)
    """Baud rate of the simulated serial lines if the driver's options state none."""
    truth: bool = True
    """True publishes the true position and force, for records and comparison."""
    scripts: bool = False
    """True accepts commands of `pincette rig`."""
    script: tuple[ScriptedOrder, ...] = Field(default=(), strict=False)
    """Commands that are executed at given times."""

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
        """Return the properties of the contact faces and the ground between two arms."""
        return self.pair or PairOfArms()

    @property
    def bouc_wen(self) -> Hysteresis:
        """Return the Bouc-Wen shape of a rig's hysteresis.

        Raises ValueError if the hysteresis is of another class.
        """
        if self.hysteresis is None:
            raise ValueError(
                "the simulated arm has relays: give [simulation.hysteresis] instead of "
                "[simulation.relays]"
            )
        return self.hysteresis
