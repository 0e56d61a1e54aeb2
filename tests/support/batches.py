"""Rigs and programs that batches are compared with the composed loop on."""

import numpy as np
from msgspec.structs import replace

from pincette.config import RigFile, derived
from pincette.control.planning.grip_plan import GripRequest, plan_grip
from pincette.control.planning.path_shapes import sinusoid
from pincette.control.planning.program import Program
from pincette.control.planning.track_plan import TrackRequest, plan_track
from pincette_batch.cases import Case, Run
from tests.support.laws import default_settings
from tests.support.rigs import Tree, demo_rig

LAWS = (
    default_settings("pbsmic", "consistent"),
    default_settings("dsmifc", "consistent"),
    default_settings("pbsmic", "printed"),
    default_settings("dsmifc", "printed"),
)


def drawn_rig(seed: int) -> RigFile:
    """The demo rig in lockstep, with plant, amplifier, instruments and times drawn by the seed."""
    chance = np.random.default_rng(seed)

    def draw(low: float, high: float) -> float:
        return float(chance.uniform(low, high))

    changes = {
        "simulation": {
            "seed": seed,
            "substep_s": [1e-3, 1e-4, 7e-4][seed % 3],
            "natural_frequency_rad_per_s": draw(2200.0, 2700.0),
            "damping_ratio": draw(0.015, 0.04),
            "creep_per_decade": [0.0, draw(0.01, 0.02)][seed % 2],
            "environment_stiffness_mN_per_um": draw(1.9, 2.4),
            "bead_contact_um": draw(29.5, 31.5),
            "sensor_noise_um": draw(0.015, 0.05),
            "drift": {"slope_um_per_s": draw(-5e-4, 5e-4), "amplitude_um": draw(0.0, 0.02)},
            "actuation_delay_s": [0.005, 0.0, 0.0033][seed % 3],
            "amplifier": [{}, {"bandwidth_hz": draw(1e3, 5e3), "saturation_V": 9.0}][seed % 2],
            "hysteresis": {"asymmetry": draw(-0.1, 0.1), "curvature_per_V": draw(-0.01, 0.01)},
        }
    }
    return demo_rig(changes, time="lockstep")


def short_track(rig: RigFile) -> Program:
    """A quick sinusoid on the part."""
    part, grip = rig.part, rig.grip
    return plan_track(
        TrackRequest(
            load_s=0.6,
            approach_um_per_s=60.0,
            seek_um_per_s=12.0,
            contact_force_mN=grip.contact_force_mN,
            zero_s=grip.zero_s,
            contact_um=part.contact_um,
            contact_tolerance_um=part.contact_tolerance_um,
            stiffness_mN_per_um=part.stiffness_mN_per_um,
            stiffness_tolerance=part.stiffness_tolerance,
            path=sinusoid("force", 10.0, 8.0, 2.0, 2),
            rate_um_per_s=1e3,
            acceleration_um_per_s2=1e6,
            pointer="",
        ),
        derived.planned_rig(rig),
    ).program


def short_grip(rig: RigFile) -> Program:
    """A quick grip, held for half a second."""
    part, grip = rig.part, rig.grip
    return plan_grip(
        GripRequest(
            force_mN=12.0,
            hold_s=0.5,
            load_s=0.8,
            approach_um_per_s=60.0,
            seek_um_per_s=12.0,
            contact_force_mN=grip.contact_force_mN,
            zero_s=grip.zero_s,
            contact_um=part.contact_um,
            contact_tolerance_um=part.contact_tolerance_um,
            stiffness_mN_per_um=part.stiffness_mN_per_um,
            stiffness_tolerance=part.stiffness_tolerance,
        ),
        derived.planned_rig(rig),
    ).program


def same(one: Run, other: Run) -> None:
    """Both have the same ticks, ending and bits."""
    assert one.phases == other.phases
    assert (one.ending, one.outcome) == (other.ending, other.outcome)
    assert one.columns.shape == other.columns.shape
    differ = np.argwhere(one.columns != other.columns)
    assert len(differ) == 0, f"column, tick: {differ[np.argsort(differ[:, 1], kind='stable')][:5]}"


TROUBLES = (
    "none",
    "little voltage",
    "much force",
    "no part",
    "another stiffness",
    "a part that yields",
    "far from where it is wanted",
    "a narrow range",
    "no measurement",
    "a coarse sensor",
    "a part too near",
    "wild gains",
)
"""What befalls the loops of ``drawn_case``, and leads most of them off their program's course."""


def drawn_case(seed: int) -> tuple[str, Case]:
    """A trouble, in turn, and a loop that meets it: program, law, rig and noise by the seed."""
    chance = np.random.default_rng(7000 + seed)

    def draw(low: float, high: float) -> float:
        return float(chance.uniform(low, high))

    trouble = TROUBLES[seed % len(TROUBLES)]
    changes: dict[str, Tree] = {
        "little voltage": {"limits": {"voltage_max_V": draw(1.9, 2.3), "slew_V_per_s": draw(2, 6)}},
        "much force": {"limits": {"force_max_mN": draw(6.0, 11.0)}},
        "no part": {"simulation": {"bead": False}},
        "another stiffness": {
            "simulation": {"environment_stiffness_mN_per_um": draw(3.2, 4.0)},
        },
        "far from where it is wanted": {
            "safety": {"following_um": draw(0.05, 0.12), "following_s": 0.001}
        },
        "a narrow range": {
            "limits": {"position_max_um": draw(25.0, 36.0)},
            "safety": {"position_margin": 0.0},
        },
        "no measurement": {"sensor": {"maximum_um": draw(10.0, 36.0)}},
        "a coarse sensor": {
            "simulation": {"sensor_noise_um": 0.0, "sensor_step_um": draw(3.0, 6.0)},
        },
        "a part too near": {"simulation": {"bead_contact_um": draw(5.0, 25.0)}},
    }
    simulation: Tree = {
        "seed": seed,
        "second_mode": {"share": draw(0.01, 0.03) if chance.integers(2) else 0.0},
        "sensor_noise_um": draw(0.015, 0.05),
        "actuation_delay_s": float(chance.choice([0.0, 0.0033, 0.005])),
    }
    own = changes.get(trouble, {})
    simulation |= own.pop("simulation", {})
    rig = demo_rig({"simulation": simulation, **own}, time="lockstep")
    program = short_grip(rig) if chance.integers(2) else short_track(rig)
    law = LAWS[int(chance.integers(len(LAWS)))]
    if trouble == "wild gains":
        law = law.with_gains(K_P=10.0 ** draw(-4.0, 0.0), K_I=10.0 ** draw(0.5, 3.0))
    guards = replace(
        program.guards,
        contact_samples=int(chance.integers(1, 5)),
        lost_samples=int(chance.integers(1, 6)),
    )
    if trouble == "a part that yields":
        guards = replace(guards, lost_fraction=draw(0.98, 1.1))
    return trouble, Case(rig, replace(program, laws=(law.spec(),), guards=guards), seed)
