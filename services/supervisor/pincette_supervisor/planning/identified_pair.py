"""Two arms and the part between them as the model in use has them; pure.

Each arm is driven as in ``identified_arm``. The part lies where it is expected, held by the ground
until both arms have touched it, and is theirs from then on (``sim.plant.pair``).
"""

from dataclasses import dataclass, replace

from pincette.config import RigFile
from pincette.control.laws.two_arms import Pair
from pincette.sim.plant.pair import move_pair
from pincette.sim.plant.pair_state import (
    APART,
    PairParameters,
    PairState,
    pair_forces_mN,
    part_gone,
)
from pincette.sim.plant.parameters import PartParameters
from pincette_supervisor.planning.identified_arm import (
    SUBSTEP_S,
    IdentifiedArm,
    Instruments,
    identified_arm,
)
from pincette_supervisor.plugin import Present

GROUND_MN = 1e6
"""What the ground holds the part by; without end, as nothing is known of it."""
HOLD_MN, LIFT_S = 0.05, 0.1
"""Force of both arms that carries the part, and for how long until it is theirs alone; assumed."""
SETTLE_S = 0.5
"""For how long arms that stand at voltages at which they press have pressed."""


@dataclass(frozen=True, slots=True)
class IdentifiedPair:
    """Where both arms and the part are; ``moved`` by a period at a time."""

    arms: tuple[IdentifiedArm, IdentifiedArm]
    """Of each its response and its output; where the tips are is in ``state``."""
    parameters: PairParameters
    state: PairState

    @property
    def tips_um(self) -> Pair:
        """x_1 and x_2."""
        return self.state.tips_um

    @property
    def forces_mN(self) -> Pair:
        """Of each arm on the part."""
        return pair_forces_mN(self.parameters, self.state)

    @property
    def targets_V(self) -> Pair:
        """Voltages that both arms go to."""
        first, second = self.arms
        return first.target_V, second.target_V

    def hang(self, arm: int, weight_mN: float) -> "IdentifiedPair":
        """Hang a weight at the tip of arm 0 or 1 in place of what hangs there."""
        first, second = (
            each.hang(weight_mN) if number == arm else each for number, each in enumerate(self.arms)
        )
        return replace(self, arms=(first, second))

    def moved(self, voltages_V: Pair) -> "IdentifiedPair":
        """Both arms a period after a sample that is answered with these voltages."""
        (first, ways_1), (second, ways_2) = (
            arm.driven(voltage_V) for arm, voltage_V in zip(self.arms, voltages_V, strict=True)
        )
        state = self.state
        for (dt_s, rests_1), (_, rests_2) in zip(ways_1, ways_2, strict=True):
            rests = tuple(zip(rests_1, rests_2, strict=True))
            state = move_pair(self.parameters, state, dt_s, rests)
        return replace(self, arms=(first, second), state=state)


def identified_pair(
    rig: RigFile, instruments: Instruments, present: Present, *, part: bool, held: bool
) -> IdentifiedPair:
    """Both arms at rest where they stand; raises ValueError on a rig of one arm.

    Parameters
    ----------
    rig
        The rig file with the model in use; its table ``simulation`` is not looked at.
    part
        Whether the part is there.
    held
        Whether both arms press it: then it lies where their tips are.
    """
    first_rig, second_rig = rig.arms
    first = identified_arm(first_rig, instruments, present.stand_V(rig), None)
    second_V = rig.safety.safe_V if present.second_V is None else present.second_V
    second = identified_arm(second_rig, instruments, second_V, None)
    if not held and present.x_um is not None:
        first = first.at(present.x_um)
    if not held and present.second_um is not None:
        second = second.at(present.second_um)
    contacts_um = first_rig.part.contact_um, second_rig.part.contact_um
    part_um = contacts_um[0]
    if held and present.x_um is not None and present.second_um is not None:
        part_um += 0.5 * (present.x_um - present.second_um - contacts_um[0] + contacts_um[1])
    parameters = PairParameters(
        first.parameters,
        second.parameters,
        gap_um=sum(contacts_um),
        part_um=part_um,
        face_mN_per_um=2.0 * rig.part.stiffness_mN_per_um,
        ground_slip_mN=GROUND_MN,
        part=PartParameters(hold_mN=HOLD_MN, lift_after_s=LIFT_S),
        lands=True,
    )
    state = PairState(first.state, second.state, part_um, part_um, APART)
    if not part:
        state = part_gone(state, "removed")
    # An arm at a voltage that presses is at rest where the part keeps it.
    rests = first.state.x_um, second.state.x_um
    state = move_pair(parameters, state, SUBSTEP_S, [rests] * round(SETTLE_S / SUBSTEP_S))
    return IdentifiedPair((first, second), parameters, state)
