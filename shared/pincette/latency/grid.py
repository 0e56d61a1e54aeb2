"""The grid that numbered samples come by, as one who receives them can see it; pure."""


class SeenGrid:
    """Lateness of samples against the grid of the earliest among them, a ``period_s`` apart.

    A sample is due one period after the one before it, for each number between them. One that
    comes before it is due shows that the grid lies earlier. One that is late by whole periods may
    have found the grid moved on, since points that are missed have no number: from there on it is
    taken to have. Where that was wrong the next sample comes early, and sets it right.
    """

    __slots__ = ("_due_s", "_number", "_period_s")

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._number: int | None = None
        self._due_s = 0.0
        """Of the newest sample."""

    def begin(self) -> None:
        """Forget the grid: the next sample begins another one."""
        self._number = None

    def lateness_s(self, number: int, at_s: float) -> float:
        """How late a sample came; one whose number does not grow begins another grid."""
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
