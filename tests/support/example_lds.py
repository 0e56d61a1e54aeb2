"""The fictitious instrument of docs/how-to/add-a-driver.md, as it behaves on its line."""

from collections.abc import Callable

LARGEST_UM = 99_999.99


class SimulatedLDS:
    """One head returns ``measure()``, in µm; None is a target out of view. Other heads are
    silent."""

    def __init__(self, measure: Callable[[], float | None], head: int = 1) -> None:
        self._measure = measure
        self._head = head
        self.asked: list[bytes] = []

    def idle(self) -> None:
        """Do nothing: this instrument only replies to requests."""

    def answer(self, line: bytes) -> bytes | None:
        """Reply to one command line."""
        self.asked.append(line)
        if line == b"*IDN?":
            return b"LDS,0017"
        return self._shown() if line == b"POS%d?" % self._head else None

    def _shown(self) -> bytes:
        x_um = self._measure()
        if x_um is None:
            return b"LOST"
        if abs(x_um) > LARGEST_UM:
            return b"OVER" if x_um > 0.0 else b"UNDER"
        return f"{x_um:+09.2f}".encode()
