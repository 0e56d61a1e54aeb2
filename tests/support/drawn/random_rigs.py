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
    asymmetry of the loop                     -0.15       0.15      assumed, Bouc-Wen
    relays: loop at full drive, %             10          23        as above
    relays: full drive, V                     2           3         half the amplifier's range
    relays: mean threshold, of it             0.6         1.4       a measured stack: 1.1 to 1.7
    relays: spread, of it                     1.3         3         a measured stack: 1.4 and more
    relays: centre, V                         0           1.5       a measured stack: its mean drive
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
from pincette.config.simulation import Relays
from tests.support.drawn.free_loop import free_loop

BISECTIONS = 24
WIDEST_A = 0.9
"""A/d beyond which the arm would move against the voltage."""
RELAYS = 0x52454C41
"""Constant that, with the seed, determines the random numbers of relays."""


def random_simulation(base: Simulation, seed: int, *, relays: bool = False) -> Simulation:
    """Draw a rig around ``base``, whose output step and lag must be resolved.

    The seed also determines the noise. With ``relays`` these replace the Bouc-Wen hysteresis; all
    other values are the same as without.
    """
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
            "hysteresis": base.bouc_wen.model_copy(
                update={"asymmetry": draw(-0.15, 0.15), "curvature_per_V": draw(-0.02, 0.02)}
            ),
        }
    )
    gain_um_per_V, width_percent = draw(16.0, 22.0), draw(10.0, 23.0)
    if relays:
        return with_gain(_with_relays(drawn, width_percent), gain_um_per_V)
    return with_loop(drawn, gain_um_per_V, width_percent)


def _with_relays(simulation: Simulation, width_percent: float) -> Simulation:
    """Return the rig with drawn relays instead of its Bouc-Wen hysteresis, with the same
    curvature."""
    chance = np.random.default_rng((RELAYS, simulation.seed))
    drawn = Relays(
        loop_share=width_percent / 100.0,
        full_drive_V=float(chance.uniform(2.0, 3.0)),
        coercive_share=float(chance.uniform(0.6, 1.4)),
        spread_share=float(chance.uniform(1.3, 3.0)),
        centre_V=float(chance.uniform(0.0, 1.5)),
        curvature_per_V=simulation.bouc_wen.curvature_per_V,
    )
    return simulation.model_copy(update={"hysteresis": None, "relays": drawn})


def with_loop(simulation: Simulation, gain_um_per_V: float, width_percent: float) -> Simulation:
    """Return the rig with this gain and this loop width at 2 V peak to peak, 0.5 Hz.

    A/d is found by bisection, since the width grows with it; then d, in which the free arm is
    linear.

    Raises
    ------
    ValueError
        If no A/d makes the loop that wide.
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
    return with_gain(_shaped(simulation, 0.5 * (low + high)), gain_um_per_V)


def with_gain(simulation: Simulation, gain_um_per_V: float) -> Simulation:
    """Return the rig with this gain at 2 V peak to peak, 0.5 Hz."""
    scale = gain_um_per_V / free_loop(simulation).gain_um_per_V
    return simulation.model_copy(update={"piezo_um_per_V": simulation.piezo_um_per_V * scale})


def _shaped(simulation: Simulation, A_over_d: float) -> Simulation:
    shape = simulation.bouc_wen.model_copy(update={"A_over_d": A_over_d})
    return simulation.model_copy(update={"hysteresis": shape})
