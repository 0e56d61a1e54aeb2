"""The inputs of one service: which samples are accepted, and which of them a step uses.

A sample of a trigger waits for its partners, the samples of other topics that are joined to it by
epoch and number. In lockstep nothing is lost, so every sample is accepted and every step waits for
all partners. In real time the bus may lose, repeat or reorder samples. Therefore numbers are
checked, only the newest sample of a stream is used, and a step is made without a partner that does
not arrive in time.
"""

from collections import deque
from copy import copy
from math import floor
from typing import Any

from pincette.core.idle_sampling import idle_periods
from pincette.core.messages import Command, Message, Sample
from pincette.core.service import AnyService, Role

KEPT = 16
"""Largest number of samples of a topic that wait for a join, and of streams that wait for a step.
If there are more, the partner of the oldest sample has been lost."""
AHEAD = 250
"""Largest excess of a sample number over the number of periods since the epoch began. It is 5 s at
T = 20 ms, more than a link stores before it is ended."""
CLOCKS_APART = 1e-3
"""Relative difference in speed that is allowed between two monotonic clocks; a bad quartz deviates
by a tenth of that.
"""
JOIN_WAIT_PERIODS = 0.25
"""Time that a step waits for its partners in real time, in control periods."""

Waiting = dict[tuple[int, int], Sample]
"""Samples by epoch and number."""
Row = list[Any]
"""Inputs of a step, in the order of the service's ``inputs_type``."""
Joined = tuple[Row, Sample | None, float]
"""Inputs of a step; the sample that triggers it, or None for a grid tick; and the arrival time of
that sample, or the time of the tick.
"""


class Joiner:
    """Waiting samples of one service, and the steps that they allow; it has no clock."""

    def __init__(
        self, service: AnyService, period_s: float, *, lockstep: bool, recorded: bool = False
    ) -> None:
        """Begin without samples.

        Parameters
        ----------
        recorded
            True for samples of a record. They are in order, so numbers are not checked; and missing
            partners will not arrive, so no step waits for them.
        """
        self._period_s = period_s
        self._lockstep = lockstep
        self._checks = not (lockstep or recorded)
        """True if numbers of triggers are checked."""
        self._needs_partners = lockstep and not recorded
        """True if no step is made without its partners."""
        self._wait_s = 0.0 if recorded else JOIN_WAIT_PERIODS * period_s
        self._idle_periods = idle_periods(period_s)
        self.refused = 0
        """Number of samples that were refused because of their number."""
        self.missed = 0
        """Number of samples that were accepted and then replaced by a newer one before use."""
        self.pending: deque[tuple[Sample | None, float]] = deque()
        """Triggers that wait for their partners, each with its arrival time; None means a grid
        tick, with its time.
        """
        self.newest: Sample | None = None
        """The sample that triggered the newest step."""
        self._epoch = 0
        self._since_s = 0.0
        self._newest_seq: dict[type[Message], int] = {}
        """Largest number of each topic in this epoch."""
        first = int(service.instrument is not None)
        joinable = [item for item in service.inputs if item.role != "pace"]
        self._blank: Row = [None] * (first + len(joinable))
        self._inputs: dict[type[Message], tuple[Role, int]] = {
            item.topic.message: (item.role, 0) for item in service.inputs
        }
        """Role of each topic, and its index in a row."""
        self._waiting: dict[type[Message], Waiting] = {}
        self._partners: list[tuple[Waiting, int, int]] = []
        """Samples, offset, and index in a row for each topic that is joined."""
        for place, item in enumerate(joinable, start=first):
            kind = item.topic.message
            self._inputs[kind] = item.role, place
            if item.role == "join":
                waiting = self._waiting[kind] = {}
                self._partners.append((waiting, item.offset, place))

    def take(self, sample: Any, now: float, epoch: int) -> Role | None:
        """Accept a sample, and return the role of its topic; None if its number is refused.

        Parameters
        ----------
        epoch
            Present epoch of the service. If too many samples wait for a join, those of other epochs
            are dropped first.
        """
        role, _ = self._inputs[type(sample)]
        if role == "trigger":
            if self._checks and not self.admits(sample, now):
                self.refused += 1
                return None
            if self._lockstep or not self.pending or self._displaces(sample):
                self.pending.append((sample, now))
        elif role == "join":
            waiting = self._waiting[type(sample)]
            waiting[sample.epoch, sample.seq] = sample
            if len(waiting) > KEPT:
                place = next((place for place in waiting if place[0] != epoch), None)
                del waiting[next(iter(waiting)) if place is None else place]
        elif self._lockstep and sample.seq >= 0 and not sample.final:
            # Arming began tick 0, which starts from the applied voltage of seq -1.
            self.pending.append((None, (sample.seq + 1) * self._period_s))
        return role

    def admits(self, sample: Sample, now: float) -> bool:
        """Return whether a sample may be the next one of its topic, and note its number.

        A sample that is not newer than an accepted one is refused. So is a sample whose number
        exceeds the number of periods since the epoch began by more than ``AHEAD``: it cannot come
        from the sensor's grid, and if it were accepted, all correct samples would be refused.

        Commands with older numbers are admitted: the actuator checks their owner and age too. Not
        checked are samples of other epochs, and samples of epoch 0, the idle loop before the first
        arming, in which the numbers of a restarted sensor begin again at 0.
        """
        if sample.epoch != self._epoch or self._epoch == 0:
            return True
        made = (now - self._since_s) * (1.0 + CLOCKS_APART) / self._period_s
        if sample.seq > floor(made) + AHEAD:
            return False
        kind = type(sample)
        if kind is Command:
            return True
        if sample.seq <= self._newest_seq.get(kind, -1):
            return False
        self._newest_seq[kind] = sample.seq
        return True

    def _displaces(self, sample: Sample) -> bool:
        """Remove samples that a new one replaces; return whether the new sample is kept.

        Only the newest sample of a stream counts; a backlog is never played. Samples of another
        epoch or owner form a separate stream, and a repeated sample is older; neither replaces the
        newest sample.
        """
        stream = stream_of(sample)
        for pending in self.pending:
            if pending[0] is not None and stream_of(pending[0]) == stream:
                if sample.seq <= pending[0].seq:
                    self.refused += 1
                    return False
                self.pending.remove(pending)
                self.missed += 1
                return True
        if len(self.pending) >= KEPT:
            self.pending.popleft()
            self.missed += 1
        return True

    def next(self, now: float) -> Joined | None:
        """Remove the first step that can be made and return its inputs; None if there is none.

        A partner that has not arrived in time is None.
        """
        pending = self.pending
        if not pending:
            return None
        sample, since_s = pending[0]
        row = [*self._blank]
        if sample is None:
            pending.popleft()
            return row, None, since_s
        epoch, seq = sample.epoch, sample.seq
        for waiting, offset, place in self._partners:
            key = epoch, seq + offset
            if key in waiting:
                row[place] = waiting[key]
            # The same sum as in ``wait_s``, to the last bit: otherwise a program would wait for 0 s
            # again and again.
            elif self._needs_partners or now < since_s + self._patience_s(sample):
                return None
        for waiting, offset, _ in self._partners:
            if (epoch, seq + offset) in waiting:
                del waiting[epoch, seq + offset]
        row[self._inputs[type(sample)][1]] = sample
        pending.popleft()
        self.newest = sample
        return row, sample, since_s

    def wait_s(self, now: float) -> float | None:
        """Return the time until a step can be made, in s: 0.0 if it can be made now.

        None if only another sample can lead to a step.
        """
        if not self.pending:
            return None
        sample, since_s = self.pending[0]
        if sample is None:
            return 0.0
        for waiting, offset, _ in self._partners:
            if (sample.epoch, sample.seq + offset) not in waiting:
                if self._needs_partners:
                    return None
                return max(0.0, since_s + self._patience_s(sample) - now)
        return 0.0

    def _patience_s(self, sample: Sample) -> float:
        """Return the time that a step waits for its partners in real time, in s.

        While the sensor idles, the actuator publishes the partner only after it has received the
        sample, so that the step waits longer, in proportion to the idle interval. A lost sample
        does not extend the wait, since an armed loop has no time for it.
        """
        newest = self.newest
        if newest is None or newest.epoch != sample.epoch:
            return self._wait_s
        idle = sample.seq - newest.seq >= self._idle_periods
        return (self._idle_periods if idle else 1) * self._wait_s

    def begin(self, epoch: int, now: float) -> None:
        """Begin an epoch at ``now``, before its first sample was made.

        Samples that wait for a step are discarded; those of this epoch that wait for a join are
        kept.
        """
        self._epoch, self._since_s = epoch, now
        self._newest_seq = {}
        self.pending.clear()
        for waiting in self._waiting.values():
            for key in [key for key in waiting if key[0] != epoch]:
                del waiting[key]

    def begin_tick(self, at_s: float) -> None:
        """Enqueue a grid tick at a time, in s, as the trigger of a step."""
        self.pending.append((None, at_s))

    def blank(self) -> Row:
        """Return the inputs of a step that no sample has caused."""
        return [*self._blank]

    def copy(self) -> "Joiner":
        """Return another joiner that continues from here independently."""
        twin = copy(self)
        twin.pending = deque(self.pending)
        twin._newest_seq = dict(self._newest_seq)
        twin._waiting = {kind: dict(waiting) for kind, waiting in self._waiting.items()}
        kinds = list(twin._waiting)  # in the order of the partners
        twin._partners = [
            (twin._waiting[kind], offset, place)
            for kind, (_, offset, place) in zip(kinds, self._partners, strict=True)
        ]
        return twin


def stream_of(sample: Sample) -> tuple[type[Sample], int, int | None]:
    """Return topic, epoch and owner of a sample; sample numbers are compared only within the same
    three.
    """
    return type(sample), sample.epoch, getattr(sample, "owner", None)
