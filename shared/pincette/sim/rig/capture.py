"""A buffered acquisition: position and drive, one sample each 1/rate, kept until drained."""

from pincette.sim.rig.wave import Grid

LONGEST_S = 60.0
"""Length of the buffer."""


class CaptureOverflowError(ValueError):
    """More samples were due than the buffer holds."""


class Capture:
    """Samples 1, 2, … after its beginning, and those not yet drained."""

    def __init__(self, begin_ns: int, rate_hz: float) -> None:
        self._grid = Grid(begin_ns, rate_hz)
        self._most = int(LONGEST_S * rate_hz)
        self._x_um: list[float] = []
        self._drive_V: list[float] = []
        self._missed = 0

    def instants_ns(self, after_ns: int, until_ns: int) -> list[int]:
        """When samples are due, after a time and up to another, as far as the buffer takes them."""
        first = max(1, self._grid.index_at(after_ns) + 1)
        due = self._grid.index_at(until_ns) + 1 - first
        room = max(0, min(due, self._most - len(self._x_um)))
        self._missed += due - room
        return [self._grid.instant_ns(index) for index in range(first, first + room)]

    def take(self, x_um: float, drive_V: float) -> None:
        """Keep a sample."""
        self._x_um.append(x_um)
        self._drive_V.append(drive_V)

    def drain(self) -> tuple[list[float], list[float]]:
        """Give what is kept: positions in µm, drive in V; raises CaptureOverflowError."""
        drained = self._x_um, self._drive_V
        missed, self._missed = self._missed, 0
        self._x_um, self._drive_V = [], []
        if missed:
            raise CaptureOverflowError(
                f"{missed} samples were lost: the buffer holds {self._most} samples, "
                f"{LONGEST_S:g} s; drain it more often"
            )
        return drained
