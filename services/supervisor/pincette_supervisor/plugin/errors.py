"""Why a request cannot be planned."""

from dataclasses import dataclass


class FaultyRequestError(ValueError):
    """Members of a request that do not go together; says which."""

    def __init__(self, pointer: str, message: str) -> None:
        super().__init__(message)
        self.pointer = pointer


@dataclass(frozen=True, slots=True)
class InstrumentBandwidth:
    """One instrument's share in the bandwidth."""

    part: str
    driver: str
    bandwidth_hz: float
    buffered_hz: float | None
    """Highest rate of a buffered acquisition or output; None where there is none."""
    exchange_s: float
    response_s: float
    note: str


class UnsupportedError(ValueError):
    """The instruments cannot do what a calibration needs."""

    def __init__(
        self,
        text: str,
        needed_hz: float,
        bandwidth_hz: float,
        parts: tuple[InstrumentBandwidth, ...],
    ) -> None:
        super().__init__(text)
        self.needed_hz = needed_hz
        self.bandwidth_hz = bandwidth_hz
        self.parts = parts
