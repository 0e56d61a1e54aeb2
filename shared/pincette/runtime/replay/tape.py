"""What stands in place of a voltage output while a record is repeated."""

from collections.abc import Sequence
from dataclasses import dataclass

from pincette.instruments.protocols import InstrumentError


@dataclass(slots=True)
class Tape:
    """Takes what it is told, and fails where the record says that the instrument did."""

    fault: str = ""

    def write_V(self, voltage_V: float) -> None:  # noqa: ARG002  it goes nowhere
        """Put out nothing."""
        self.look()

    def read_V(self) -> float:
        """As at rest; what was put out when the epoch began is told by the record."""
        return 0.0

    def begin_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:  # noqa: ARG002
        """Put out nothing."""
        self.look()

    def look(self) -> None:
        """Fail, where that is recorded."""
        if self.fault:
            raise InstrumentError(self.fault)

    def close(self) -> None:
        """Have nothing to give back."""
