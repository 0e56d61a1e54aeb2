"""Pairs of random arms, each taught by itself, and the part between them."""

from dataclasses import dataclass

import numpy as np

from pincette.config import RigFile
from pincette_study.beyond.tracks import CLASSES, REACH_UM
from pincette_study.calibrated_free import with_calibrated_response
from pincette_study.rigs import simulation_of

FIRST_SEED = 501
"""Seeds of single rigs and of the search for gains are below."""
SPREAD = 0.05
"""By which mode and compliance of an arm differ from those printed; the law knows s_p alone."""


@dataclass(frozen=True, slots=True)
class TaughtPair:
    """Two arms with their models, and where their part lies."""

    hysteresis: str
    """One of ``beyond.CLASSES``."""
    number: int
    arms: tuple[RigFile, RigFile]
    contacts_um: tuple[float, float]
    """Where each tip touches a part that lies in the middle."""


def taught_pair(base: RigFile, hysteresis: str, number: int) -> TaughtPair:
    """Draw the pair of a number, and teach each arm its free response with the part away."""
    seeds = FIRST_SEED + 2 * number, FIRST_SEED + 2 * number + 1
    chance = np.random.default_rng([FIRST_SEED, number])
    contacts_um = 30.0 + float(chance.uniform(-1, 1)), 30.0 + float(chance.uniform(-1, 1))
    arms = taught_arm(base, hysteresis, seeds[0]), taught_arm(base, hysteresis, seeds[1])
    return TaughtPair(hysteresis, number, arms, contacts_um)


def taught_arm(base: RigFile, hysteresis: str, seed: int) -> RigFile:
    """Draw an arm, of which the compliance is measured and the mode taken as printed; teach it."""
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
