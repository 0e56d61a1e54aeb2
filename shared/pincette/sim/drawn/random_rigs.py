"""Simulated rigs drawn at random, each from its seed alone.

Uniform between the bounds; "of base" multiplies the value of the rig that is varied.

    quantity                                  from        to        source
    first mode ω_n, of base                   0.90        1.10      assumed
    damping ratios ζ, each of three           0.015       0.04      assumed
    second mode, over the first               6.27·0.97   6.27·1.03 instruments: near 6.27
    second mode, static share                 0.015       0.035     cantilever: 0.0255
    compliance s_p, of base                   0.85        1.15      assumed
    gain d_p at 2 V p-p, µm/V                 16          22        paper: 19.0
    loop at 2 V p-p, % of the stroke          10          23        instruments: 15-23, paper rigs
    asymmetry of the loop                     -0.15       0.15      assumed
    curvature κ of the gain, 1/V              -0.02       0.02      assumed
    creep per decade                          0.01        0.02      instruments: 1-2 %
    passive arm, stiffness, of base           0.80        1.20      assumed
    passive arm, mode, of base's or ω_n       0.90        1.10      instruments: 388 Hz too
    contact, µm beside base                   -2          2         assumed
    modulus E* of the faces, GPa              30          45        glass on glass: 37
    adhesion w, J/m²                          0.05        0.1       instruments
    roughness factor                          0           0.5       assumed
    sensor noise, µm r.m.s.                   0.015       0.050     instruments
    drift, slope, µm/s                        -0.0005     0.0005    assumed
    drift, amplitude, µm                      0           0.02      assumed
    drift, cycle, s                           300         1200      assumed
    amplifier, gain                           0.995       1.005     assumed
    amplifier, bandwidth, Hz                  1000        5000      assumed

What falls or breaks a part, the sensor's step and the output stay as they are.
"""

import numpy as np

from pincette.config import Simulation
from pincette.config.simulated_parts import Hysteresis
from pincette.sim.drawn.free_loop import free_loop

BISECTIONS = 24
WIDEST_A = 0.9
"""A/d beyond which the arm would move against the voltage."""


def random_simulation(base: Simulation, seed: int) -> Simulation:
    """Draw a rig around ``base``, whose output must be resolved; the seed is its noise's, too."""
    chance = np.random.default_rng(seed)

    def draw(low: float, high: float) -> float:
        return float(chance.uniform(low, high))

    omega = base.natural_frequency_rad_per_s
    passive_omega = base.passive_natural_frequency_rad_per_s or omega
    drawn = base.model_copy(
        update={
            "seed": seed,
            "natural_frequency_rad_per_s": omega * draw(0.9, 1.1),
            "damping_ratio": draw(0.015, 0.04),
            "second_mode": base.second_mode.model_copy(
                update={
                    "frequency_ratio": 6.27 * draw(0.97, 1.03),
                    "share": draw(0.015, 0.035),
                    "damping_ratio": draw(0.015, 0.04),
                }
            ),
            "compliance_um_per_mN": base.compliance_um_per_mN * draw(0.85, 1.15),
            "creep_per_decade": draw(0.01, 0.02),
            "environment_stiffness_mN_per_um": (
                base.environment_stiffness_mN_per_um * draw(0.8, 1.2)
            ),
            "passive_natural_frequency_rad_per_s": passive_omega * draw(0.9, 1.1),
            "passive_damping_ratio": draw(0.015, 0.04),
            "bead_contact_um": base.bead_contact_um + draw(-2.0, 2.0),
            "part": base.part.model_copy(
                update={
                    "modulus_GPa": draw(30.0, 45.0),
                    "adhesion_J_per_m2": draw(0.05, 0.1),
                    "roughness": draw(0.0, 0.5),
                }
            ),
            "sensor_noise_um": draw(0.015, 0.05),
            "drift": base.drift.model_copy(
                update={
                    "slope_um_per_s": draw(-5e-4, 5e-4),
                    "amplitude_um": draw(0.0, 0.02),
                    "cycle_s": draw(300.0, 1200.0),
                }
            ),
            "amplifier": base.amplifier.model_copy(
                update={"gain_ratio": draw(0.995, 1.005), "bandwidth_hz": draw(1e3, 5e3)}
            ),
            "hysteresis": base.hysteresis.model_copy(
                update={"asymmetry": draw(-0.15, 0.15), "curvature_per_V": draw(-0.02, 0.02)}
            ),
        }
    )
    return with_loop(drawn, gain_um_per_V=draw(16.0, 22.0), width_percent=draw(10.0, 23.0))


def with_loop(simulation: Simulation, gain_um_per_V: float, width_percent: float) -> Simulation:
    """The rig with this gain and this width of loop at 2 V peak to peak, 0.5 Hz.

    A/d by bisection, since the width grows with it; then d, in which the free arm is linear.

    Raises
    ------
    ValueError
        Where no A/d makes the loop so wide.
    """
    low, high = 0.0, WIDEST_A
    if free_loop(_shaped(simulation, high)).width_percent < width_percent:
        raise ValueError(f"no hysteresis of this shape makes a loop of {width_percent} %")
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if free_loop(_shaped(simulation, middle)).width_percent < width_percent:
            low = middle
        else:
            high = middle
    shaped = _shaped(simulation, 0.5 * (low + high))
    scale = gain_um_per_V / free_loop(shaped).gain_um_per_V
    return shaped.model_copy(update={"piezo_um_per_V": shaped.piezo_um_per_V * scale})


def _shaped(simulation: Simulation, A_over_d: float) -> Simulation:
    shape: Hysteresis = simulation.hysteresis.model_copy(update={"A_over_d": A_over_d})
    return simulation.model_copy(update={"hysteresis": shape})
