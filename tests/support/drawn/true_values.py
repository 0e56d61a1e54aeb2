"""True values that a calibration should find, computed from the plant itself."""

import math
from dataclasses import dataclass

from pincette.config import Simulation
from pincette.sim.plant.parameters import plant_parameters
from tests.support.drawn.free_loop import free_loop


@dataclass(frozen=True, slots=True)
class TrueValues:
    """True values of a simulated rig."""

    natural_frequency_rad_per_s: float
    """Undamped natural frequency of the free arm's first mode, in rad/s."""
    damping_ratio: float
    compliance_um_per_mN: float
    """s_p: static compliance of the driven arm, in µm/mN."""
    piezo_um_per_V: float
    """d_p: secant gain of the free arm at 2 V peak to peak, 0.5 Hz, settled."""
    loop_percent: float
    """Largest width of the hysteresis loop at that voltage, in percent of its stroke."""
    contact_stiffness_mN_per_um: float
    """K_e: secant of the static force over the driven tip's position."""
    contact_um: float
    noise_um: float
    """R.m.s. noise of a reading, in µm: white noise, and rounding to the sensor's step
    (step/√12)."""


def true_values(
    simulation: Simulation,
    least_mN: float = 2.0,
    most_mN: float = 20.0,
    mean_V: float = 0.0,
) -> TrueValues:
    """Return the true values of a rig: K_e between two forces, d_p about a mean voltage.

    Raises
    ------
    ValueError
        If the forces are not positive and increasing, or the values do not describe a plant.
    """
    if not 0.0 < least_mN < most_mN:
        raise ValueError(f"forces of {least_mN} and {most_mN} mN: must be above 0 and rising")
    loop = free_loop(simulation, mean_V=mean_V)
    depth_um = pressed_um(simulation, most_mN) - pressed_um(simulation, least_mN)
    return TrueValues(
        simulation.natural_frequency_rad_per_s,
        simulation.damping_ratio,
        simulation.compliance_um_per_mN,
        loop.gain_um_per_V,
        loop.width_percent,
        (most_mN - least_mN) / depth_um,
        simulation.bead_contact_um,
        math.hypot(simulation.sensor_noise_um, simulation.sensor_step_um / math.sqrt(12.0)),
    )


def pressed_um(simulation: Simulation, force_mN: float) -> float:
    """Return the distance of the driven tip from the first touch at a static force, in µm.

    x - x_b = F/K_e + B·F^(2/3): the passive arm yields, and the faces of the part are pressed in.
    """
    hertz = plant_parameters(simulation).part.hertz_um_per_mN23
    yields_um = force_mN / simulation.environment_stiffness_mN_per_um
    return yields_um + hertz * force_mN ** (2.0 / 3.0)
