"""Instruments that measure 1 µm and output nothing."""


class Laser:
    def read_um(self) -> float:
        return 1.0

    def close(self) -> None:
        """Do nothing: there is no port to close."""


class Output:
    def write_V(self, voltage_V: float) -> None:
        """Moves nothing."""

    def read_V(self) -> float:
        return 0.0

    def close(self) -> None:
        """Do nothing: there is no port to close."""
