"""Which samples a step is made of: those whose number may come next, joined by number."""

from copy import copy
from math import floor
from typing import Any, NamedTuple

from pincette.core.messages import Command, Message, Sample
from pincette.core.service import AnyService

KEPT = 16
"""Samples kept for a join, where what waits longer has lost its partner, and streams that wait."""

AHEAD = 250
"""Samples of slack: 5 s at T = 20 ms, more than a link keeps before it is given up."""
CLOCKS_APART = 1e-3
"""By how much two monotonic clocks may differ in speed; a bad quartz has a tenth of it."""

Waiting = dict[tuple[int, int], Sample]
"""Samples by epoch and number."""


class Pending(NamedTuple):
    """A trigger that waits for its partners; ``sample`` is None for a tick of the grid."""

    sample: Sample | None
    since: float


class Synchronizer:
    """The samples of one service that wait for theirs; no clock."""

    def __init__(self, service: AnyService) -> None:
        device = service.instrument is not None
        told = [item for item in service.inputs if item.role in ("trigger", "join")]
        places = {item.topic.message: device + place for place, item in enumerate(told)}
        self._places = places
        self._waiting: dict[type, Waiting] = {}
        self._partners: list[tuple[Waiting, int, int]] = []
        """What waits, by how much its number differs, and its place in a row."""
        self._blank: tuple[Any, ...] = (None,) * (device + len(told))
        for item in told:
            if item.role == "join":
                kind = item.topic.message
                waiting = self._waiting[kind] = {}
                self._partners.append((waiting, item.offset, places[kind]))

    def keep(self, sample: Sample, epoch: int) -> None:
        """Keep a sample until its step; of too many, one of another epoch goes, else the oldest."""
        waiting = self._waiting[type(sample)]
        waiting[sample.epoch, sample.seq] = sample
        if len(waiting) > KEPT:
            place = next((place for place in waiting if place[0] != epoch), None)
            del waiting[next(iter(waiting)) if place is None else place]

    def begin(self, epoch: int) -> None:
        """Keep what is of this epoch alone."""
        for waiting in self._waiting.values():
            for place in [place for place in waiting if place[0] != epoch]:
                del waiting[place]

    def complete(self, sample: Sample) -> bool:
        """Whether all partners of a trigger have come."""
        for waiting, offset, _ in self._partners:
            if (sample.epoch, sample.seq + offset) not in waiting:
                return False
        return True

    def row(self) -> list[Any]:
        """Inputs of a step that no sample has led to."""
        return list(self._blank)

    def row_of(self, sample: Sample) -> list[Any]:
        """Inputs of the step that a trigger leads to; a partner that has not come is None."""
        row = list(self._blank)
        row[self._places[type(sample)]] = sample
        for waiting, offset, place in self._partners:
            row[place] = waiting.pop((sample.epoch, sample.seq + offset), None)
        return row

    def copy(self) -> "Synchronizer":
        """Another one that goes on from here by itself."""
        twin = copy(self)
        twin._waiting = {kind: dict(waiting) for kind, waiting in self._waiting.items()}
        kinds = list(twin._waiting)  # in the order of the partners
        twin._partners = [
            (twin._waiting[kind], offset, place)
            for kind, (_, offset, place) in zip(kinds, self._partners, strict=True)
        ]
        return twin


class SequenceFilter:
    """Which numbers may come next in real time, where a bus may lose, double or reorder.

    A sample that is not newer than one that was taken is dropped. Nor can there be more samples of
    an epoch than periods since it began here: a number beyond that was not made by the sensor's
    grid, and would shut out all that are right.

    A command is let through with any older number: the actuator judges it by its owner and age too.
    Epoch 0 is the idle loop before the first arming, where a restarted sensor begins again at 0.
    """

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

    def copy(self) -> "SequenceFilter":
        """Another one that goes on from here by itself."""
        twin = SequenceFilter(self._period_s)
        twin._epoch, twin._since_s = self._epoch, self._since_s
        twin._newest = dict(self._newest)
        return twin


def stream_of(sample: Sample) -> tuple[type[Sample], int, int | None]:
    """Topic, epoch and owner: what numbers of samples are compared within."""
    return type(sample), sample.epoch, getattr(sample, "owner", None)
