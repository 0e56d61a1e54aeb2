"""What the controller gets, and what it remembers from one sample to the next."""

from typing import NamedTuple

from pincette.control.laws.law import Law, LawState
from pincette.control.laws.two_arms import TwoArmParameters, TwoArmState
from pincette.control.planning.program import Program
from pincette.control.record import FrozenRecord
from pincette.control.safety.monitors import UNSEEN, Watches
from pincette.core.faults import Fault
from pincette.core.messages import Action, Estimate
from pincette_controller.actions import RunningLease
from pincette_controller.arm_memory import ArmMemory
from pincette_controller.learning import Learning
from pincette_controller.player_state import Foreseen, Player


class Inputs(NamedTuple):
    """The estimate of the newest sample."""

    estimate: Estimate | None


class SecondState(FrozenRecord, frozen=True):
    """What a rig of two arms has beside: the second arm's memory, and the law of both."""

    arm: ArmMemory
    laws: tuple[TwoArmParameters, ...] = ()
    memory: TwoArmState | None = None
    """None where no law holds."""
    watches: Watches = UNSEEN
    """Of the hard limits of the second arm."""


class State(FrozenRecord, frozen=True):
    """The program, where it stands, and the memory of law and arm."""

    arm: ArmMemory
    """It outlives an arming, as the arm's own does."""
    epoch: int = 0
    owner: int = 0
    seq: int = -1
    loaded: Program | None = None
    """What the next arming plays; loading it does not touch what plays now."""
    program: Program | None = None
    playing: bool = False
    laws: tuple[Law, ...] = ()
    """Those of ``program``."""
    player: Player | None = None
    foreseen: Foreseen | None = None
    """Of the player, while the next sample has not come."""
    memory: LawState | None = None
    learning: Learning | None = None
    """Along the cycles of a program that learns."""
    pending: tuple[Action, ...] = ()
    lease: RunningLease | None = None
    """Without one the program plays to its end, with or without a supervisor."""
    watches: Watches = UNSEEN
    """What the check of the hard limits has seen."""
    silenced: Fault | None = None
    """Why it commands no more, though no action has ended the program."""
    refused: int = 0
    found: Fault | None = None
    """Why it has stopped, or stops, without an action that asks for it."""
    second: SecondState | None = None
    """Of a rig of two arms."""

    @property
    def findings(self) -> tuple[Fault, ...]:
        """Faults of this program that people see."""
        return () if self.found is None else (self.found,)
