"""Which numbers may come next, in real time, where a bus may lose, double or reorder; pure.

A sample that is not newer than one that has been taken is dropped: what comes of a stream is what
comes of its part that is in order. Nor can there be more samples of an epoch than periods since it
began here; a number beyond that was not made by the sensor's grid, and taken once it would shut
out all that are right.

A command is let through with any older number: it is the actuator that judges it, by its owner and
its age too, and tells. Epoch 0 is the idle loop before the first arming, where a sensor that is
started again begins anew at 0.
"""

from math import floor

from pincette.messages import Command, Message, Sample

AHEAD = 250
"""Samples of slack: 5 s at T = 20 ms, more than a link keeps before it is given up."""
CLOCKS_APART = 1e-3
"""By how much two monotonic clocks may differ in speed; a bad quartz has a tenth of it."""


class Numbering:
    """The newest number taken of each topic in this epoch, and when the epoch began here."""

    __slots__ = ("_epoch", "_newest", "_period_s", "_since_s")

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._epoch = 0
        self._since_s = 0.0
        self._newest: dict[type[Message], int] = {}

    def begin(self, epoch: int, now: float) -> None:
        """An epoch has begun at ``now``, in s, before its first sample was made."""
        self._epoch, self._since_s = epoch, now
        self._newest = {}

    def admits(self, sample: Sample, now: float) -> bool:
        """Whether a sample may be the next of its topic; one of another epoch is not judged."""
        if sample.epoch != self._epoch or self._epoch == 0:
            return True
        made = (now - self._since_s) * (1.0 + CLOCKS_APART) / self._period_s
        if sample.seq > floor(made) + AHEAD:
            return False
        kind = type(sample)
        if kind is Command:
            return True
        if sample.seq <= self._newest.get(kind, -1):
            return False
        self._newest[kind] = sample.seq
        return True

    def copy(self) -> "Numbering":
        """Another one that goes on from here by itself."""
        twin = Numbering(self._period_s)
        twin._epoch, twin._since_s = self._epoch, self._since_s
        twin._newest = dict(self._newest)
        return twin
