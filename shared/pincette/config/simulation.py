"""What only a simulated rig knows."""

from pydantic import Field

from pincette.config.tables import NotNegative, Positive, Table


class Hysteresis(Table):
    """Normalised Bouc-Wen shape: dh/dt = A du/dt - b|du/dt|h - g du/dt|h|, y = d u - h."""

    A_over_d: NotNegative
    b_times_U: NotNegative
    g_times_U: float
    full_drive_V: Positive


class Simulation(Table):
    """The simulated rig: what the plant is, which no other program may know."""

    seed: int = Field(default=1, ge=0)
    substep_s: Positive = 0.001
    natural_frequency_rad_per_s: Positive
    damping_ratio: Positive
    compliance_um_per_mN: Positive
    piezo_um_per_V: Positive
    hysteresis: Hysteresis
    creep_per_decade: NotNegative
    sensor_noise_um: NotNegative
    sensor_step_um: Positive
    output_step_V: Positive
    output_lag_s: NotNegative
    actuation_delay_s: NotNegative
    """Lockstep: from the sample to the arrival of the voltage."""
    bead: bool = True
    bead_contact_um: float
    environment_stiffness_mN_per_um: Positive
    baud: int = Field(default=115200, ge=1200)
    truth: bool = True
