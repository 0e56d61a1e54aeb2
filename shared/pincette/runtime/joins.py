"""Which samples a step is made of: its trigger, and the partners that are joined by number."""

from copy import copy
from typing import Any

from pincette.messages import Sample
from pincette.service import AnyService

KEPT = 16
"""Samples kept for a join, where what waits longer has lost its partner, and streams that wait."""

Waiting = dict[tuple[int, int], Sample]
"""Samples by epoch and number."""


class Joins:
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
        """Let a sample wait for the step that it belongs to.

        Where too many do, the oldest of another epoch goes, or else the oldest: no stranger pushes
        out what counts.
        """
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
        row = self.row()
        row[self._places[type(sample)]] = sample
        for waiting, offset, place in self._partners:
            row[place] = waiting.pop((sample.epoch, sample.seq + offset), None)
        return row

    def copy(self) -> "Joins":
        """Another one that goes on from here by itself."""
        twin = copy(self)
        twin._waiting = {kind: dict(waiting) for kind, waiting in self._waiting.items()}
        kinds = list(twin._waiting)  # in the order of the partners
        twin._partners = [
            (twin._waiting[kind], offset, place)
            for kind, (_, offset, place) in zip(kinds, self._partners, strict=True)
        ]
        return twin
