"""What only a simulated rig knows."""

from pydantic import Field

from pincette.config.script import ScriptedOrder
from pincette.config.simulated_parts import Amplifier, Bead, Drift, Hysteresis, SecondMode
from pincette.config.tables import NotNegative, Positive, Table


class Simulation(Table):
    """The simulated rig: what the plant is, which no other program may know.

    Each quantity that has a default is switched off by it.
    """

    seed: int = Field(default=1, ge=0)
    """Of the sensor's noise."""
    substep_s: Positive = 0.001
    """s. Longest step of the plant; the arms are exact over it for an input that is settling."""
    natural_frequency_rad_per_s: Positive
    """rad/s, undamped, of the free driven arm's first mode; paper (54): 2437.8."""
    damping_ratio: Positive
    """1, of that mode; paper (54): 0.026."""
    second_mode: SecondMode = SecondMode()
    """Without it the arm has one mode."""
    compliance_um_per_mN: Positive
    """µm/mN. s_p, of the driven arm's tip, all modes together; paper (55): 0.46."""
    piezo_um_per_V: Positive
    """µm/V at the amplifier's input. d of y = d·u·(1 + κ·u) - h."""
    hysteresis: Hysteresis
    """Of the arm's free motion."""
    creep_per_decade: NotNegative
    """1, per decade of time after a step; 0.01-0.02 by the literature."""
    sensor_noise_um: NotNegative
    """µm r.m.s., white; 0.015-0.05 for a laser at this resolution."""
    sensor_step_um: Positive
    """µm, of the reading; paper section VI.A: 0.025."""
    averaging_s: NotNegative = 0.0
    """s. The reading is the mean position over this time; the LK-G5000's is up to 4^i samples."""
    drift: Drift = Drift()
    """Of the reading."""
    output_step_V: Positive | None = None
    """V, of the voltage output; None: as the driver's instrument has it."""
    output_lag_s: NotNegative | None = None
    """s, first-order, of the voltage output; None: as the driver's instrument has it."""
    amplifier: Amplifier = Amplifier()
    """Without it the arm has the output's voltage."""
    actuation_delay_s: NotNegative
    """Lockstep: from the sample to the arrival of the voltage."""
    bead: bool = True
    """Whether a part lies there at the beginning."""
    bead_contact_um: float
    """µm. Position of the driven arm's tip at the first touch, the passive arm at rest."""
    environment_stiffness_mN_per_um: Positive
    """mN/µm. The passive arm's; instruments: about 2.17."""
    passive_natural_frequency_rad_per_s: Positive | None = None
    """rad/s, of the passive arm alone; instruments: 388 Hz too. None: an arm without mass."""
    passive_damping_ratio: Positive = 0.026
    """1, of the passive arm alone; as the driven arm's, assumed."""
    part: Bead = Bead()
    """What lies there."""
    baud: int = Field(default=115200, ge=1200)
    """Of the simulated serial lines, where the driver's options name none."""
    truth: bool = True
    """Whether the true position and force are published, for records and comparison."""
    scripts: bool = False
    """Whether it takes orders: `pincette rig`."""
    script: tuple[ScriptedOrder, ...] = Field(default=(), strict=False)
    """Orders that are carried out at their times."""
