"""Voltages of an arm's past in few pieces, so that another model can follow them.

A hysteresis without rate depends on the turning points of the voltage alone, creep on how long it
rested; between turning points nothing need be kept. A small to-and-fro is left out.
"""

from math import ceil
from typing import NamedTuple

from pincette.control.record import FrozenRecord
from pincette.control.response.free_response import FreeResponse

SMALL_V = 0.01
"""A change that begins no piece: some steps of the output, and what the sensor's noise makes."""
STRIDE_V = 0.05
"""Longest step in which a model is led."""
MOST_PIECES = 512
"""Beyond it the oldest are forgotten; later and wider swings have wiped most of them out."""


class Piece(NamedTuple):
    """A move to a voltage in some time, and a rest there."""

    to_V: float
    move_s: float
    rest_s: float


class VoltageMemory(FrozenRecord, frozen=True):
    """Pieces since the arm was unpoled at 0 V."""

    pieces: tuple[Piece, ...] = ()
    """The oldest first; most voltages leave them as they are."""
    newest: tuple[Piece, ...] = ()
    """The last of them, apart: one, or none where it is still among ``pieces``."""

    @property
    def path(self) -> tuple[Piece, ...]:
        """Return all pieces, oldest first."""
        return (*self.pieces, *self.newest)

    def follow(self, voltage_V: float, dt_s: float) -> "VoltageMemory":
        """Take in a voltage that has held for ``dt_s``."""
        pieces, newest = self.pieces, self.newest
        if not newest:
            if not pieces:
                return VoltageMemory((), (Piece(voltage_V, dt_s, 0.0),))
            pieces, newest = pieces[:-1], pieces[-1:]
        (last,) = newest
        change_V = voltage_V - last.to_V
        if abs(change_V) < SMALL_V:
            rested = Piece(last.to_V, last.move_s, last.rest_s + dt_s)
            return VoltageMemory(pieces, (rested,))
        came_from_V = pieces[-1].to_V if pieces else 0.0
        if last.rest_s == 0.0 and change_V * (last.to_V - came_from_V) > 0.0:
            return VoltageMemory(pieces, (Piece(voltage_V, last.move_s + dt_s, 0.0),))
        kept = (*pieces, last)[1 - MOST_PIECES :]
        return VoltageMemory(kept, (Piece(voltage_V, dt_s, 0.0),))

    def replayed(self, response: FreeResponse) -> FreeResponse:
        """Lead a model through all pieces, from its present voltage."""
        at_V = response.voltage_V
        for to_V, move_s, rest_s in self.path:
            strides = max(1, ceil(abs(to_V - at_V) / STRIDE_V))
            for stride in range(1, strides + 1):
                share = stride / strides
                response = response.follow(at_V + share * (to_V - at_V), move_s / strides)
            if rest_s > 0.0:
                response = response.follow(to_V, rest_s)
            at_V = to_V
        return response
