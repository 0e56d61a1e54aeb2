"""What the actuator remembers beside the rules: what waits, what plays, what was answered."""

from dataclasses import dataclass

from pincette.control.planning.sweep import Sweep
from pincette.control.replacing import replace
from pincette.control.safety.state import SafetyState
from pincette.messages import Command


@dataclass(frozen=True, slots=True)
class State(SafetyState):
    """The state of the safety module, and that of the service around it."""

    pending: Command | None = None
    """A command that has overtaken its sample."""
    answered_seq: int = -1
    sweep: Sweep | None = None
    """What the instrument plays about ``voltage_V``."""

    def settled(self) -> "State":
        """Outside an arming nothing plays; what waits is judged when its sample comes, since in
        lockstep that ends the tick."""
        if self.mode == "armed" or self.sweep is None:
            return self
        return replace(self, sweep=None)
