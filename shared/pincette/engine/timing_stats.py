"""Timing statistics of one service, collected while it runs; this module reads no clock.

Until the outputs of a step are published, times are only noted; the statistics are updated after
that.
"""

from math import inf
from typing import Any

from pincette.core.messages import Sample, Timing
from pincette.core.service import AnyService
from pincette.latency.histogram import Histogram

KEPT = 16
"""Number of samples whose arrival times are kept; as many as may wait for a join."""
PUBLISH_EVERY_S = 1.0
Outputs = tuple[Any, ...]
"""Messages with the number of a sample."""


class SeenGrid:
    """Lateness of samples against the grid of the earliest among them, ``period_s`` apart.

    A sample is due n periods after an earlier sample if their numbers differ by n. A sample that
    arrives before it is due shows that the grid is earlier than assumed. If a sample is late by
    whole periods, the grid is assumed to have moved, since missed points have no number. If that is
    wrong, the next sample arrives early and corrects it.
    """

    __slots__ = ("_due_s", "_number", "_period_s")

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._number: int | None = None
        self._due_s = 0.0
        """Due time of the newest sample, in s."""

    def begin(self) -> None:
        """Discard the grid: the next sample begins another one."""
        self._number = None

    def lateness_s(self, number: int, at_s: float) -> float:
        """Return the lateness of a sample, in s.

        A sample whose number does not increase begins another grid.
        """
        before, self._number = self._number, number
        if before is None or number <= before:
            self._due_s = at_s
            return 0.0
        due_s = self._due_s + (number - before) * self._period_s
        late_s = at_s - due_s
        if late_s < 0.0:
            self._due_s = at_s
            return 0.0
        self._due_s = due_s + late_s // self._period_s * self._period_s
        return late_s


class TimingStats:
    """Lateness relative to the program's or the samples' grid, age of the first input, and
    execution time.
    """

    __slots__ = (
        "_acts_on",
        "_age",
        "_age_s",
        "_began_s",
        "_came_s",
        "_come",
        "_epoch",
        "_execution",
        "_lateness",
        "_missed",
        "_newest",
        "_numbers",
        "_own_grid",
        "_publish_at_s",
        "_seen",
        "_service",
    )

    def __init__(self, service: AnyService, period_s: float, *, own_grid: bool) -> None:
        self._service = service.name
        self._acts_on = service.inputs[0].topic.message
        self._own_grid = own_grid
        self._lateness, self._age, self._execution = Histogram(), Histogram(), Histogram()
        self._seen = SeenGrid(period_s)
        self._numbers = [-1] * KEPT
        self._came_s = [0.0] * KEPT
        self._newest = -1
        self._epoch = self._missed = 0
        self._began_s = 0.0
        self._come: tuple[int, float] | None = None
        """Number and time of a sample whose lateness is not included yet."""
        self._age_s: float | None = None
        """Age of the sample of the newest step, whose outputs are not published yet, in s."""
        self._publish_at_s = inf

    def begin(self, epoch: int, missed: int) -> None:
        """Begin an epoch; ``missed`` is the number skipped since the start before it."""
        self._epoch, self._missed, self._newest = epoch, missed, -1
        self._numbers = [-1] * KEPT
        self._seen.begin()
        self._come = self._age_s = None
        for histogram in (self._lateness, self._age, self._execution):
            histogram.clear()

    def came(self, sample: Sample, at_s: float) -> None:
        """Note a sample that arrived at ``at_s``; only the first arrival of each number is used."""
        seq = sample.seq
        place = seq % KEPT
        if sample.epoch != self._epoch or self._numbers[place] == seq:
            return
        self._numbers[place] = seq
        self._came_s[place] = at_s
        if self._own_grid:
            return
        if self._come is not None:
            self._lateness.add(self._seen.lateness_s(*self._come))
        self._come = seq, at_s

    def fired(self, sample: Sample | None, now: float, outputs: Outputs) -> None:
        """Note that a step which began at ``now`` with a sample has returned its outputs."""
        self._began_s = now
        if outputs:
            self._newest = outputs[0].seq
        if sample is None or type(sample) is not self._acts_on or sample.epoch != self._epoch:
            return
        place = sample.seq % KEPT
        if self._numbers[place] == sample.seq:
            self._age_s = now - self._came_s[place]

    def clocked(self, due_s: float, now: float, outputs: Outputs) -> None:
        """Note that a step which began at ``now``, due at ``due_s``, has returned its outputs."""
        self._began_s = now
        if outputs:
            self._newest = outputs[0].seq
        self._lateness.add(now - due_s)

    def published(self, now: float) -> None:
        """Note that the outputs of the step have been published."""
        self._execution.add(now - self._began_s)
        if self._age_s is not None:
            self._age.add(self._age_s)
            self._age_s = None
        if self._come is not None:
            self._lateness.add(self._seen.lateness_s(*self._come))
            self._come = None

    def starts(self, now: float) -> None:
        """Start publishing the statistics, for the first time after one interval."""
        self._publish_at_s = now + PUBLISH_EVERY_S

    def due(self, now: float) -> bool:
        """Return whether it is time to publish; if so, start the next interval."""
        if now < self._publish_at_s:
            return False
        self.starts(now)
        return True

    def timing(self, missed: int) -> Timing:
        """Return the statistics of this epoch; ``missed`` is the number skipped since the start."""
        if self._come is not None:
            self._lateness.add(self._seen.lateness_s(*self._come))
            self._come = None
        return Timing(
            epoch=self._epoch,
            seq=self._newest,
            service=self._service,
            missed=missed - self._missed,
            lateness=self._lateness.distribution(),
            age=self._age.distribution(),
            execution=self._execution.distribution(),
        )
