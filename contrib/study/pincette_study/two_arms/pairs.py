"""Pairs of random arms with separately identified models, and the part between them."""

from dataclasses import dataclass

import numpy as np

from pincette.config import RigFile, derived
from pincette.control.arm.plant import ArmParameters, consistent_arm
from pincette.control.response.hysteresis import HysteresisModel
from pincette.sim.plant.pair_state import PairParameters
from pincette.sim.plant.plant import plant_parameters
from pincette_study.beyond.tracks import CLASSES, REACH_UM
from pincette_study.calibrated_free import with_calibrated_response
from pincette_study.rigs import simulation_of

FIRST_SEED = 501
"""First seed of the pairs. The seeds of single rigs and of the search for gains are lower."""
SPREAD = 0.05
"""Relative spread of mode and compliance around the printed values. The law knows only s_p."""


@dataclass(frozen=True, slots=True)
class Instruments:
    """Instruments of both arms."""

    period_s: float
    delay_s: float
    """Delay from a sample to its voltages, in s."""
    lag_s: float
    output_step_V: float
    sensor_step_um: float
    substep_s: float
    slew_V_per_s: float


SLOW = Instruments(0.02, 0.005, 0.0033, 0.001220703125, 0.025, 0.001, 50.0)
"""Instruments of ``demo.toml``."""
FAST = Instruments(0.001, 0.00065, 0.0, 0.00030517578125, 0.003, 0.00025, 60.0)
"""Instruments of ``kilohertz.toml``."""


@dataclass(frozen=True, slots=True)
class TaughtPair:
    """Two arms with their models, and the position of their part."""

    hysteresis: str
    """Class of hysteresis; one of ``beyond.CLASSES``."""
    number: int
    arms: tuple[RigFile, RigFile]
    contacts_um: tuple[float, float]
    """Position of each tip in µm at which it touches a part in the middle."""


def taught_pair(base: RigFile, hysteresis: str, number: int) -> TaughtPair:
    """Draw the pair with this number, and identify the free response of each arm without the
    part.
    """
    seeds = FIRST_SEED + 2 * number, FIRST_SEED + 2 * number + 1
    chance = np.random.default_rng([FIRST_SEED, number])
    contacts_um = 30.0 + float(chance.uniform(-1, 1)), 30.0 + float(chance.uniform(-1, 1))
    arms = taught_arm(base, hysteresis, seeds[0]), taught_arm(base, hysteresis, seeds[1])
    return TaughtPair(hysteresis, number, arms, contacts_um)


def taught_arm(base: RigFile, hysteresis: str, seed: int) -> RigFile:
    """Draw an arm with measured compliance and the printed mode, and identify its free response."""
    rig, _ = CLASSES[hysteresis](base, seed)
    simulation, chance = simulation_of(rig), np.random.default_rng([FIRST_SEED, seed])
    faster = 1.0 + float(chance.uniform(-SPREAD, SPREAD))
    softer = 1.0 + float(chance.uniform(-SPREAD, SPREAD))
    compliance = simulation.compliance_um_per_mN * softer
    omega_n = simulation.natural_frequency_rad_per_s * faster
    drawn = {"natural_frequency_rad_per_s": omega_n, "compliance_um_per_mN": compliance}
    low_um, high_um = REACH_UM
    update = {
        "simulation": simulation.model_copy(update=drawn),
        "model": rig.model.model_copy(update={"compliance_um_per_mN": compliance}),
        "law": rig.law.model_copy(update={"set": None}),
        "limits": rig.limits.model_copy(
            update={"position_min_um": low_um, "position_max_um": high_um}
        ),
    }
    return with_calibrated_response(rig.model_copy(update=update))


def arm_of(rig: RigFile) -> ArmParameters:
    """Return m, b, k, d of an arm, as in its rig file."""
    model = rig.model
    return consistent_arm(
        model.natural_frequency_rad_per_s,
        model.damping_ratio,
        model.piezo_um_per_V,
        model.compliance_um_per_mN,
    )


def model_of(rig: RigFile) -> HysteresisModel:
    """Return the identified free response; raises TypeError if there is none."""
    response = derived.free_response(rig.model)
    model = getattr(response, "model", None)
    if not isinstance(model, HysteresisModel):
        raise TypeError("an arm of a pair needs an identified free response: teach it")
    return model


def plant_of(pair: TaughtPair, made: Instruments) -> PairParameters:
    """Return both arms as simulated, with the part in the middle."""
    first, second = (
        plant_parameters(
            simulation_of(rig).model_copy(
                update={
                    "output_step_V": made.output_step_V,
                    "output_lag_s": made.lag_s,
                    "substep_s": made.substep_s,
                }
            )
        )
        for rig in pair.arms
    )
    near_um, far_um = pair.contacts_um
    return PairParameters(first, second, near_um + far_um, near_um)
