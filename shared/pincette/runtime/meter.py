"""How punctual one service is, counted as it goes; no clock of its own.

Until the outputs of a step are told only times are noted; they are counted after that.
"""

from math import inf
from typing import Any

from pincette.latency.grid import SeenGrid
from pincette.latency.histogram import Histogram
from pincette.messages import Sample, Timing
from pincette.service import AnyService

KEPT = 16
"""Samples whose arrival is remembered; as many as may wait for a join."""
TOLD_EVERY_S = 1.0
Outputs = tuple[Any, ...]
"""Messages that carry the number of a sample."""


class Meter:
    """Lateness, age and execution time of the steps of an epoch.

    A service with a grid of its own is late against that; one without is late where its samples
    are. Age is that of its first input, which it acts on.
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
        "_seen",
        "_service",
        "_tell_at_s",
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
        """Number and time of a sample whose lateness is not counted yet."""
        self._age_s: float | None = None
        """Of what the step acts on that is not told yet."""
        self._tell_at_s = inf

    def begin(self, epoch: int, missed: int) -> None:
        """An epoch begins; ``missed`` were skipped before it, since the start."""
        self._epoch, self._missed, self._newest = epoch, missed, -1
        self._numbers = [-1] * KEPT
        self._seen.begin()
        self._come = self._age_s = None
        for histogram in (self._lateness, self._age, self._execution):
            histogram.clear()

    def came(self, sample: Sample, at_s: float) -> None:
        """A sample that came at ``at_s`` was taken; the first of its number is looked at."""
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
        """A step that began at ``now`` with a sample has given its outputs."""
        self._began_s = now
        if outputs:
            self._newest = outputs[0].seq
        if sample is None or type(sample) is not self._acts_on or sample.epoch != self._epoch:
            return
        place = sample.seq % KEPT
        if self._numbers[place] == sample.seq:
            self._age_s = now - self._came_s[place]

    def clocked(self, due_s: float, now: float, outputs: Outputs) -> None:
        """A step that began at ``now``, asked for by the clock at ``due_s``, has given them."""
        self._began_s = now
        if outputs:
            self._newest = outputs[0].seq
        self._lateness.add(now - due_s)

    def told(self, now: float) -> None:
        """All that came of the step has been told."""
        self._execution.add(now - self._began_s)
        if self._age_s is not None:
            self._age.add(self._age_s)
            self._age_s = None
        if self._come is not None:
            self._lateness.add(self._seen.lateness_s(*self._come))
            self._come = None

    def starts(self, now: float) -> None:
        """From here on its timing is to be told, the first time after a while."""
        self._tell_at_s = now + TOLD_EVERY_S

    def due(self, now: float) -> bool:
        """Whether it is time to tell; asked again, it counts from there."""
        if now < self._tell_at_s:
            return False
        self.starts(now)
        return True

    def timing(self, missed: int) -> Timing:
        """What was counted of this epoch; ``missed`` were skipped since the start."""
        if self._come is not None:
            self._lateness.add(self._seen.lateness_s(*self._come))
            self._come = None
        return Timing(
            epoch=self._epoch,
            seq=self._newest,
            service=self._service,
            missed=missed - self._missed,
            lateness=self._lateness.told(),
            age=self._age.told(),
            execution=self._execution.told(),
        )
