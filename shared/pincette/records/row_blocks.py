"""Joins the samples of one epoch into rows, block by block, so that memory stays bounded."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from pincette.core.messages import (
    Applied,
    Command,
    Estimate,
    GroundTruth,
    Message,
    Position,
    Sample,
    Telemetry,
)
from pincette.records.columns import RUNNING, columns, table_of

ROWS = 8192
"""Number of rows in a block. A row counts as complete when that many later rows have begun."""
NAMES: Mapping[type[Message], str] = {
    Position: "position",
    Estimate: "estimate",
    Command: "command",
    Applied: "applied",
}
"""Topics whose losses are counted."""


class RowBlocks:
    """Rows of one epoch.

    A run of less than two blocks is joined as a whole by ``columns``. A longer one is returned in
    blocks, in order; a message for a row that was already returned is ignored.
    """

    def __init__(self, period_s: float, *, every_tick: bool = True, rows: int = ROWS) -> None:
        """Begin an epoch.

        If ``every_tick``, a simulated rig also counts ticks without a command.
        """
        self._period_s, self._every_tick, self._rows = period_s, every_tick, rows
        self._samples: dict[type[Message], dict[int, Message]] = {}
        self._truths: dict[int, GroundTruth] = {}
        self._next = 0
        """Lowest number of a row that has not been returned."""
        self.given = 0
        """Number of rows that were returned."""
        self.two_arms = False
        """True once the actuator has reported a second arm."""
        self._over: int | None = None
        """Number of the last sample of the arming; None while the arming continues."""
        self._newest_applied = -1
        self._tripped: bool = False
        self._first_truth: int | None = None
        self._places = self._placed_seq = 0
        """Number of true values that belong to ticks before ``_placed_seq``."""
        self._missing: Counter[str] = Counter()
        self._applied: set[int] = set()
        """Numbers of the applied voltages in the newest returned block; its missing samples have
        been counted."""

    def add(self, message: Message) -> None:
        """Add a message of the epoch, in order of arrival."""
        if isinstance(message, GroundTruth):
            if not self._tripped:  # later ones belong to no row
                self._truths[message.seq] = message
            return
        if not isinstance(message, Sample):
            return
        if isinstance(message, Applied):
            self._newest_applied = max(self._newest_applied, message.seq)
            self.two_arms = self.two_arms or len(message.arms) > 1
            if message.final and message.seq >= 0:
                self._over = min(message.seq, message.seq if self._over is None else self._over)
        if message.seq >= self._next:
            self._samples.setdefault(type(message), {})[message.seq] = message

    @property
    def full(self) -> bool:
        """Return whether a block can be taken."""
        return max(map(len, self._samples.values()), default=0) >= 2 * self._rows

    def take(self) -> dict[str, list[Any]]:
        """Return the oldest block as columns, and drop its messages."""
        seqs = sorted({seq for samples in self._samples.values() for seq in samples})
        table = self._table(seqs[: self._rows])
        self._next = seqs[: self._rows][-1] + 1
        for samples in self._samples.values():
            for seq in [seq for seq in samples if seq < self._next]:
                del samples[seq]
        for number in [one for one in self._truths if one < self._number_of_place()]:
            del self._truths[number]
        self.given += len(table["seq"])
        return table

    def rest(self) -> dict[str, list[Any]]:
        """Return the columns of the remaining rows, which are kept."""
        if not self._next:
            messages = [one for samples in self._samples.values() for one in samples.values()]
            return columns([*messages, *self._truths.values()], self._period_s)
        places, seq, tripped = self._places, self._placed_seq, self._tripped
        missing, applied = self._missing.copy(), {*self._applied}
        table = self._table(sorted({seq for one in self._samples.values() for seq in one}))
        self._places, self._placed_seq, self._tripped = places, seq, tripped
        self._missing, self._applied = missing, applied
        return table

    @property
    def missing(self) -> dict[str, int]:
        """Return the number of samples that were sent and never arrived, by topic."""
        # A sample proves that the sample from which it was derived was sent: an estimate proves its
        # position and the applied voltage that it names, the telemetry of a playing program its
        # estimate, and a tick with an accepted command its command.
        found = self._missing + self._missing_in(self._samples, {*self._applied})
        return {name: found[name] for name in NAMES.values() if found[name]}

    def _missing_in(
        self, samples: Mapping[type[Message], Mapping[int, Message]], applied: set[int]
    ) -> Counter[str]:
        came = {kind: samples.get(kind, {}) for kind in (*NAMES, Telemetry)}
        sent: dict[type[Message], set[int]] = {kind: set() for kind in NAMES}
        for seq, estimate in came[Estimate].items():
            sent[Position].add(seq)
            if isinstance(estimate, Estimate) and estimate.applied_seq >= self._next - self._rows:
                sent[Applied].add(estimate.applied_seq)
        for seq, one in came[Telemetry].items():
            if isinstance(one, Telemetry) and one.playing:
                sent[Estimate].add(seq)
        for seq, one in came[Applied].items():
            if isinstance(one, Applied) and one.answered:
                sent[Command].add(seq)
        sent[Applied] -= applied
        applied |= sent[Applied]
        return Counter(
            {
                name: sum(1 for seq in sent[kind] if seq >= 0 and seq not in came[kind])
                for kind, name in NAMES.items()
            }
        )

    def _table(self, seqs: list[int]) -> dict[str, list[Any]]:
        """Return columns of the next rows; count their missing samples."""
        found = {
            kind: {seq: samples[seq] for seq in seqs if seq in samples}
            for kind, samples in self._samples.items()
        }
        counted = {*self._applied}
        self._missing += self._missing_in(found, counted)
        begin = min(seqs, default=0)
        self._applied = {*found.get(Applied, {}), *(seq for seq in counted if seq >= begin)}
        found[GroundTruth] = self._truths_of(seqs, found.get(Applied, {}))
        over = self._over
        numbers = [seq for seq in seqs if seq >= 0 and (over is None or seq <= over)]
        return table_of(found, numbers, self._period_s, two=self.two_arms)

    def _number_of_place(self) -> int:
        return (self._first_truth or 0) + self._places

    def _truths_of(self, seqs: list[int], applied: Mapping[int, Message]) -> dict[int, Message]:
        """Return the true values of some rows; see ``number_truths``."""
        if self._first_truth is None:
            self._first_truth = min(self._truths, default=None)
        found: dict[int, Message] = {}
        if self._first_truth is None:
            return found
        for seq in seqs:
            tick = applied.get(seq)
            if isinstance(tick, Applied) and tick.state not in RUNNING:
                self._tripped = True
            if self._tripped or seq > self._newest_applied:
                break
            self._places += seq - self._placed_seq  # ticks without any message
            self._placed_seq = seq + 1
            answered = not isinstance(tick, Applied) or tick.answered
            if not (answered or self._every_tick):
                continue
            truth = self._truths.get(self._number_of_place())
            self._places += 1
            if truth is not None:
                found[seq] = replace(truth, seq=seq)
        return found
