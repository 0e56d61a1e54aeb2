"""Memory of an arm's voltages in the controller, for laws of the identified set.

It is updated by the voltage applied in every tick of an epoch, with or without a law, in the same
way as the estimator's memory, and is bit-identical to that memory.
"""

from msgspec import field

from pincette.control.record import FrozenRecord
from pincette.control.response.free_response import FreeResponse
from pincette.control.response.voltage_memory import VoltageMemory
from pincette.core.messages import Estimate


class ArmMemory(FrozenRecord, frozen=True):
    """Free response of an arm, updated up to the newest sample."""

    response: FreeResponse
    model: FreeResponse
    """Initial ``response``, unpoled."""
    past: VoltageMemory = field(default_factory=VoltageMemory)
    """Voltages since the start, which are replayed if the model changes."""
    followed_seq: int = -1
    """Newest sample up to which ``response`` has been updated."""

    def updated(self, estimate: Estimate, voltage_V: float, period_s: float) -> "ArmMemory":
        """Update the memory by the voltage applied to this arm.

        After a missing voltage, the next one counts for a longer time. A sample is processed once
        only.
        """
        if estimate.degraded or estimate.seq <= self.followed_seq:
            return self
        passed_s = (estimate.seq - self.followed_seq) * period_s
        return ArmMemory(
            self.response.updated(voltage_V, passed_s),
            self.model,
            self.past.updated(voltage_V, passed_s),
            estimate.seq,
        )

    def armed(self, model: FreeResponse) -> "ArmMemory":
        """Begin an epoch with a model; a changed model first replays the past voltages."""
        same = model == self.model
        response = self.response if same else self.past.replayed(model)
        return ArmMemory(response, model, self.past)
