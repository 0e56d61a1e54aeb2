"""Whether the instruments of a rig can make a calibration at all; said before anything moves."""

from dataclasses import dataclass

from pincette.config import RigFile
from pincette.instruments.protocols import Timing
from pincette.runtime.timing import budget


@dataclass(frozen=True, slots=True)
class Part:
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
        self, text: str, needed_hz: float, bandwidth_hz: float, parts: tuple[Part, ...]
    ) -> None:
        super().__init__(text)
        self.needed_hz = needed_hz
        self.bandwidth_hz = bandwidth_hz
        self.parts = parts


def require_sweep(rig: RigFile, to_hz: float, capture_hz: float) -> None:
    """Refuse a frequency response that the instruments are too slow for.

    The mode is identified from samples at four times its highest frequency at least, acquired
    and put out from buffers whose clocks do not wait for the loop.

    Raises
    ------
    UnsupportedError
        With the bandwidth that there is, and each instrument's part in it.
    """
    timing = budget(rig)
    parts = (
        _part("sensor", rig.sensor.driver, timing.sensor),
        _part("output", rig.output.driver, timing.output),
    )
    faults = [_fault(part, capture_hz) for part in parts]
    bandwidth_hz = timing.bandwidth_hz
    if bandwidth_hz < to_hz:
        faults.append(f"both together reach {bandwidth_hz:.1f} Hz, {to_hz:g} Hz are needed")
    faults = [fault for fault in faults if fault]
    if faults:
        model = rig.model
        raise UnsupportedError(
            f"{'; '.join(faults)}. model.natural_frequency_rad_per_s = "
            f"{model.natural_frequency_rad_per_s:g} rad/s and model.damping_ratio = "
            f"{model.damping_ratio:g} stay as the rig file has them, assumed",
            to_hz,
            bandwidth_hz,
            parts,
        )


def _part(name: str, driver: str, timing: Timing) -> Part:
    return Part(
        name,
        driver,
        timing.bandwidth_hz,
        timing.buffered_hz,
        timing.exchange_s,
        timing.response_s,
        timing.note,
    )


def _fault(part: Part, rate_hz: float) -> str:
    what = "acquisition" if part.part == "sensor" else "output"
    if part.buffered_hz is None:
        return f"{part.part} ({part.driver}): no buffered {what}"
    if part.buffered_hz < rate_hz:
        return (
            f"{part.part} ({part.driver}): buffered {what} at {part.buffered_hz:g} Hz at most, "
            f"{rate_hz:g} Hz are needed"
        )
    return ""
