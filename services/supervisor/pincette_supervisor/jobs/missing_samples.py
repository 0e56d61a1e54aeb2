"""Counts the positions that a calibration lacks while it is measured, so that it need not go on.

A phase in which more are missing than may be gives no values: what is over is not played to its
end.
"""

from collections import Counter
from collections.abc import Iterable

from pincette.api.endings import Ending
from pincette.core.messages import Message, Position, Telemetry
from pincette_supervisor.calibration.samples import MOST_MISSING
from pincette_supervisor.planning.planned import Planned

LATE = 10
"""Samples that may be on their way: the topics of a tick come on links of their own."""


class MissingSamples:
    """Of one epoch, phase by phase; a job other than a calibration may lack what it will."""

    def __init__(self, planned: Planned, epoch: int, period_s: float) -> None:
        self._epoch = epoch
        self._planned: Counter[str] = Counter()
        """Samples of each phase, as planned; of one that waits for a person there is no number."""
        if planned.plan.kind == "calibrate":
            for phase in planned.plan.phases:
                if phase.duration_s is not None:
                    self._planned[phase.phase] += round(phase.duration_s / period_s)
        self._phase: str = ""
        self._first, self._newest, self._found = 0, -1, 0
        """``_found``: valid positions since the phase began."""

    def follow(self, messages: Iterable[Message]) -> None:
        """Take new messages."""
        for message in messages:
            if isinstance(message, Position):
                self._found += message.epoch == self._epoch and message.valid
            elif isinstance(message, Telemetry) and message.epoch == self._epoch:
                if message.phase != self._phase:
                    self._phase, self._first, self._found = message.phase, message.seq, 0
                self._newest = message.seq

    @property
    def lack(self) -> tuple[str, Ending] | None:
        """That a phase lacks too many, in words and as a code; None where it does not."""
        planned = self._planned[self._phase]
        count = self._newest - self._first + 1 - self._found
        if not planned or count <= MOST_MISSING * planned + LATE:
            return None
        words = (
            f"{count} of the {planned} samples of {self._phase} are missing already, limit "
            f"{100.0 * MOST_MISSING:g} %: see to the sensor's line, and to the machine "
            "(`pincette timing`)"
        )
        values = {"missing": count, "planned": planned, "limit": MOST_MISSING}
        return words, Ending(code="samples_missing", values=values)
