"""Compressed history of an arm's voltage, with which another model can be brought up to date.

Rate-independent hysteresis depends only on the turning points of the voltage, and creep on the
duration of its rests. Nothing has to be stored between turning points. Small alternating motion is
omitted.
"""

from math import ceil
from typing import NamedTuple

from pincette.control.record import FrozenRecord
from pincette.control.response.free_response import FreeResponse

SMALL_V = 0.01
"""Largest change that does not begin a new piece, in V: some output steps and the effect of sensor
noise."""
STRIDE_V = 0.05
"""Largest voltage step with which a model follows the pieces, in V."""
MOST_PIECES = 512
"""Largest number of pieces. If there are more, the oldest are discarded; later and wider swings
have mostly erased their effect."""


class Piece(NamedTuple):
    """A monotonic move to a voltage in a given time, and a rest there."""

    to_V: float
    move_s: float
    rest_s: float


class VoltageMemory(FrozenRecord, frozen=True):
    """Pieces of the voltage since the arm was unpoled at 0 V."""

    pieces: tuple[Piece, ...] = ()
    """Pieces except the newest, oldest first. Most updates do not change them."""
    newest: tuple[Piece, ...] = ()
    """Newest piece, stored separately; empty if the newest piece is among ``pieces``."""

    @property
    def path(self) -> tuple[Piece, ...]:
        """Return all pieces, oldest first."""
        return (*self.pieces, *self.newest)

    def updated(self, voltage_V: float, dt_s: float) -> "VoltageMemory":
        """Add a voltage that has been applied for ``dt_s``."""
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
        """Return a model updated with all pieces, from its present voltage."""
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
