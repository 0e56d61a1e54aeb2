"""Voltages of an arm's past in few pieces, so that another model can follow them.

A hysteresis without rate depends on the turning points of the voltage alone, creep on the duration
of its rests. Between turning points nothing has to be stored. A small to-and-fro is omitted.
"""

from math import ceil
from typing import NamedTuple

from pincette.control.record import FrozenRecord
from pincette.control.response.free_response import FreeResponse

SMALL_V = 0.01
"""Largest change that begins no piece, in V: some steps of the output, and the effect of sensor
noise."""
STRIDE_V = 0.05
"""Longest step in which a model follows the pieces, in V."""
MOST_PIECES = 512
"""Largest number of pieces; beyond it the oldest are discarded, most of which later and wider
swings have wiped out."""


class Piece(NamedTuple):
    """A move to a voltage in some time, and a rest there."""

    to_V: float
    move_s: float
    rest_s: float


class VoltageMemory(FrozenRecord, frozen=True):
    """Pieces of the voltage since the arm was unpoled at 0 V."""

    pieces: tuple[Piece, ...] = ()
    """Pieces except the newest, oldest first; most voltages leave them unchanged."""
    newest: tuple[Piece, ...] = ()
    """Newest piece, kept separately; empty if it is still among ``pieces``."""

    @property
    def path(self) -> tuple[Piece, ...]:
        """Return all pieces, oldest first."""
        return (*self.pieces, *self.newest)

    def updated(self, voltage_V: float, dt_s: float) -> "VoltageMemory":
        """Add a voltage that has held for ``dt_s``."""
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
        """Return a model after all pieces, from its present voltage."""
        at_V = response.voltage_V
        for to_V, move_s, rest_s in self.path:
            strides = max(1, ceil(abs(to_V - at_V) / STRIDE_V))
            for stride in range(1, strides + 1):
                share = stride / strides
                response = response.updated(at_V + share * (to_V - at_V), move_s / strides)
            if rest_s > 0.0:
                response = response.updated(to_V, rest_s)
            at_V = to_V
        return response
