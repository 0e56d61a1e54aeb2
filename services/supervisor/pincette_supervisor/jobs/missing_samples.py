"""Counts the positions that a job lacks while it plays.

A kind of job that needs every sample gets no values from a phase that lacks too many: such a job
is not played to its end.
"""

from collections import Counter
from collections.abc import Iterable

from pincette.api.endings import Ending
from pincette.api.job_kinds import job_kinds
from pincette.core.messages import Message, Position, Telemetry
from pincette_supervisor.plugin import Planned
from pincette_supervisor.plugin.figures import MOST_MISSING

WAITING_ROWS = 10_000
"""Number of positions that are remembered at most while a job waits for a person."""


class MissingSamples:
    """The positions that one epoch lacks, phase by phase, where the kind of job needs them all."""

    def __init__(self, planned: Planned, epoch: int, period_s: float) -> None:
        self._epoch = epoch
        self._planned: Counter[str] = Counter()
        """Samples of each phase, as planned; of one that waits for a person there is no number."""
        if job_kinds()[planned.plan.kind].needs_every_sample:
            for phase in planned.plan.phases:
                if phase.duration_s is not None:
                    self._planned[phase.phase] += round(phase.duration_s / period_s)
        self._phase: str = ""
        self._first, self._newest = 0, -1
        self._valid: set[int] = set()
        """Numbers of the valid positions since the phase began."""

    def follow(self, messages: Iterable[Message]) -> None:
        """Take new messages; those of each topic come in order."""
        if not self._planned:
            return
        for message in messages:
            if not isinstance(message, Position | Telemetry) or message.epoch != self._epoch:
                continue
            if isinstance(message, Telemetry):
                self._begin(message.phase, message.seq)
                continue
            self._newest = message.seq
            if message.arms[0].valid:
                self._valid.add(message.seq)
            if not self._planned[self._phase] and len(self._valid) > WAITING_ROWS:
                self._valid = {one for one in self._valid if one > message.seq - WAITING_ROWS // 2}

    def _begin(self, phase: str, seq: int) -> None:
        """Count anew, unless it is the same phase."""
        if phase != self._phase:
            self._phase, self._first = phase, seq
            self._valid = {one for one in self._valid if one >= seq}

    @property
    def lack(self) -> tuple[str, Ending] | None:
        """That a phase lacks too many, in words and as a code; None where it does not."""
        planned = self._planned[self._phase]
        count = self._newest - self._first + 1 - len(self._valid)
        if not planned or count <= MOST_MISSING * planned:
            return None
        words = (
            f"{count} of the {planned} samples of {self._phase} are missing already, limit "
            f"{100.0 * MOST_MISSING:g} %: see to the sensor's line, and to the machine "
            "(`pincette latency --of-rig`)"
        )
        values = {"missing": count, "planned": planned, "limit": MOST_MISSING}
        return words, Ending(code="samples_missing", values=values)
