"""Two driven arms and the part between them: parameters and state; pure.

The position of each arm is positive towards the part; x_1 + x_2 = g when both touch it without
pressing.
"""

import math
from dataclasses import dataclass
from typing import Literal

from msgspec.structs import replace

from pincette.control.record import FrozenRecord
from pincette.sim.plant.drive import quantised_V
from pincette.sim.plant.pair_modes import Contact, Ground, Pair, PairNumbers
from pincette.sim.plant.parameters import RIGID, PartParameters, PlantParameters
from pincette.sim.plant.plant import start as arm_at_rest
from pincette.sim.plant.state import Event, PlantState

APART = Contact(first=False, second=False, ground=Ground.HOLDS)
"""Contact state of a part on the ground that no arm touches."""


@dataclass(frozen=True, slots=True, eq=False)
class PairParameters:
    """Parameters of two arms and the part between them; raises ValueError.

    The part in the parameters of the individual arms has no effect.
    """

    first: PlantParameters
    second: PlantParameters
    gap_um: float
    """Gap g in µm: x_1 + x_2 when both tips touch the part without pressing it."""
    part_um: float
    """Position x_1 in µm at which the first arm touches the part at its initial position."""
    face_mN_per_um: float = 80.0
    """Stiffness K_f of each face; both faces of a glass ball between flat arms have about 40 mN/µm.
    """
    ground_mN_per_um: float = 5.0
    """Stiffness k_r with which the ground holds the part, in mN/µm; assumed."""
    ground_slip_mN: float = 0.0
    """Force f above which the part slips on the ground, in mN; 0 for a loose part."""
    part: PartParameters = RIGID
    """Weight, lift and break of the part; the parameters of the faces are those of this class."""
    pull_off_mN: Pair = (0.0, 0.0)
    """Pull-off force of the face at each arm, in mN."""
    lands: bool = False
    """True if a lifted part that is released lies on the ground again at its old position."""

    def __post_init__(self) -> None:
        for arm in (self.first, self.second):
            if arm.second_share > 0.0 or arm.amplifier.lag_s > 0.0:
                raise ValueError("an arm of a pair must have one mode and an amplifier without lag")
        for name in ("face_mN_per_um", "ground_mN_per_um"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} = {getattr(self, name)} mN/µm: must be above 0")

    @property
    def arms(self) -> tuple[PlantParameters, PlantParameters]:
        """Parameters of both arms."""
        return self.first, self.second


class PairState(FrozenRecord, frozen=True):
    """State of both arms and the part."""

    first: PlantState
    second: PlantState
    part_um: float
    """Position z of the part along x_1, in µm."""
    anchor_um: float
    """Position z_a towards which the ground pulls the part, in µm."""
    contact: Contact = APART
    part: Literal["there", "lost", "broken", "removed"] = "there"
    held_s: float = 0.0
    """Time for which the smaller one of both forces has carried the part, in s."""
    events: tuple[Event, ...] = ()

    @property
    def tips_um(self) -> Pair:
        """Positions x_1 and x_2 of the tips, in µm."""
        return self.first.x_um, self.second.x_um


def start_pair(p: PairParameters) -> PairState:
    """Return both arms unpoled and at rest, with the part on the ground."""
    return PairState(arm_at_rest(), arm_at_rest(), p.part_um, p.part_um)


def set_pair_voltages(p: PairParameters, state: PairState, voltages_V: Pair) -> PairState:
    """Set the target of each output stage, rounded to its step."""
    state = set_arm_voltage(p, state, 0, voltages_V[0])
    return set_arm_voltage(p, state, 1, voltages_V[1])


def set_arm_voltage(p: PairParameters, state: PairState, arm: int, voltage_V: float) -> PairState:
    """Set the target of the output stage of one arm, 0 or 1."""
    one = (state.first, state.second)[arm]
    driven = replace(one, target_V=quantised_V(p.arms[arm], voltage_V))
    return replace(state, second=driven) if arm else replace(state, first=driven)


def pair_forces_mN(p: PairParameters, state: PairState) -> Pair:
    """Return the force of each arm on the part in mN, compressive and positive.

    The force is negative if the part is pulled.
    """
    contact, z = state.contact, state.part_um
    x_1, x_2 = state.tips_um
    return (
        p.face_mN_per_um * (x_1 - z) if contact.first else 0.0,
        p.face_mN_per_um * (x_2 - p.gap_um + z) if contact.second else 0.0,
    )


def remove_pair_part(state: PairState) -> PairState:
    """Remove the part; the arms continue from their positions."""
    return part_gone(state, "removed")


def pair_numbers(p: PairParameters) -> PairNumbers:
    """Return masses, dampings and stiffnesses of both arms, faces and ground."""
    first, second = p.arms
    return PairNumbers(
        masses=(_mass(first), _mass(second)),
        dampings=(_damping(first), _damping(second)),
        stiffnesses=(1.0 / first.compliance_um_per_mN, 1.0 / second.compliance_um_per_mN),
        face_mN_per_um=p.face_mN_per_um,
        ground_mN_per_um=p.ground_mN_per_um,
    )


def _mass(arm: PlantParameters) -> float:
    return 1.0 / arm.compliance_um_per_mN / arm.natural_frequency_rad_per_s**2


def _damping(arm: PlantParameters) -> float:
    return 2.0 * arm.damping_ratio * arm.natural_frequency_rad_per_s * _mass(arm)


def part_gone(state: PairState, how: Literal["lost", "broken", "removed"]) -> PairState:
    """Return the state without a part; the arms continue from their positions."""
    nothing = Contact(first=False, second=False, ground=Ground.AWAY)
    return replace(state, contact=nothing, held_s=0.0, part=how)
