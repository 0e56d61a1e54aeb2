"""Buffered acquisition: position and drive, one sample every 1/rate, stored until drained."""

from pincette.sim.rig.wave import Grid

LONGEST_S = 60.0
"""Length of the buffer, in s."""


class CaptureOverflowError(ValueError):
    """Error of a capture with more samples than the buffer holds."""


class Capture:
    """Buffer of a capture: the samples since its start that have not been drained."""

    def __init__(self, begin_ns: int, rate_hz: float) -> None:
        self._grid = Grid(begin_ns, rate_hz)
        self._most = int(LONGEST_S * rate_hz)
        self._x_um: list[float] = []
        self._drive_V: list[float] = []
        self._missed = 0

    def instants_ns(self, after_ns: int, until_ns: int) -> list[int]:
        """Return the sample times between two times, limited by the space in the buffer."""
        first = max(1, self._grid.index_at(after_ns) + 1)
        due = self._grid.index_at(until_ns) + 1 - first
        room = max(0, min(due, self._most - len(self._x_um)))
        self._missed += due - room
        return [self._grid.instant_ns(index) for index in range(first, first + room)]

    def take(self, x_um: float, drive_V: float) -> None:
        """Store a sample."""
        self._x_um.append(x_um)
        self._drive_V.append(drive_V)

    def drain(self) -> tuple[list[float], list[float]]:
        """Return and remove the stored positions in µm and drive in V.

        Raises CaptureOverflowError.
        """
        drained = self._x_um, self._drive_V
        missed, self._missed = self._missed, 0
        self._x_um, self._drive_V = [], []
        if missed:
            raise CaptureOverflowError(
                f"{missed} samples were lost: the buffer holds {self._most} samples, "
                f"{LONGEST_S:g} s; drain it more often"
            )
        return drained
