"""The two types of instrument of a rig: driver, address and range."""

from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field

from pincette.config.tables import NotNegative, Positive, Table

NO_RFC2217 = (
    "rfc2217:// is not supported, since opening such a port or changing its settings blocks "
    "for seconds; set the baud rate at the device server, configure a raw TCP port there, "
    "and use socket://HOST:PORT"
)


def _reachable(url: str) -> str:
    """Return a valid URL with a lower-case scheme: a device, or a host and port."""
    scheme, separator, rest = url.partition("://")
    url = f"{scheme.lower()}{separator}{rest}" if separator else url
    if url.startswith("rfc2217://"):
        raise ValueError(NO_RFC2217)
    if not url.startswith("socket://"):
        return url
    try:
        parts = urlsplit(url)
        if parts.hostname and parts.port:
            return url
    except ValueError:
        pass
    raise ValueError("expected socket://HOST:PORT with a port from 1 to 65535, or a device")


Url = Annotated[str, AfterValidator(_reachable)]
Options = dict[str, str | int | float | bool]
"""Options of one driver, which validates them itself."""
SerialNumber = Annotated[str, Field(max_length=60)]
"""Serial number on the name plate of an instrument; empty if it is unknown."""


class Sensor(Table):
    """The position sensor: driver, address, and range in µm."""

    driver: str
    """Name of the driver, as listed by ``pincette doctor --drivers``."""
    url: Url
    """Address: a device, ``socket://HOST:PORT``, or another form documented by the driver."""
    serial_number: SerialNumber = ""
    """Serial number of the instrument; stored with each calibration."""
    minimum_um: float
    """Lower end of the range; a reading below it is invalid."""
    maximum_um: float
    """Upper end of the range; a reading above it is invalid."""
    offset_um: float = 0.0
    """Offset that is subtracted from the reading, so that the arm at rest is near zero."""
    direction: Literal[1, -1] = 1
    """Sign of the reading: +1 if it increases when the gripper closes."""
    timeout_s: Positive = 0.1
    """Time limit of an exchange with the instrument; in real time at most 0.8 of a control period.
    """
    noise_um: NotNegative
    """Identified noise of the reading (r.m.s.); it contributes to the force uncertainty."""
    drift_um_per_min: NotNegative = 0.0
    """Largest drift of the reading, for example due to the room temperature; its contribution to
    the force uncertainty grows with the time since the force was zeroed. 0 means no drift. The
    calibration ``noise`` measures it at rest.
    """
    record: str | None = None
    """File that records every byte to and from the instrument."""
    options: Options = Field(default_factory=Options)
    """Options of this driver."""


class Output(Table):
    """The voltage output that drives the amplifier."""

    driver: str
    """Name of the driver, as listed by ``pincette doctor --drivers``."""
    url: Url
    """Address: a device, ``socket://HOST:PORT``, or another form documented by the driver."""
    serial_number: SerialNumber = ""
    """Serial number of the instrument; stored with each calibration."""
    timeout_s: Positive = 0.1
    """Time limit of an exchange with the instrument."""
    record: str | None = None
    """File that records every byte to and from the instrument."""
    step_V: NotNegative = 0.0
    """Smallest step of the voltage, for example 20 V/2^14 for 14 bits over ±10 V; 0: unknown.

    Only multiples of it are applied. The hysteresis of the arm depends on the voltage that was
    actually applied: if the output itself rounded voltages, the error of the free response would
    grow with each small reversal.
    """
    shaping: bool = False
    """True writes each step of the voltage in three parts (1/4, 1/2, 1/4), which do not excite the
    mode of the arm. It is meant for outputs that time the parts with their own clock, such as
    "nidaqmx".
    """
    shaping_interval_s: Positive | None = None
    """Time between two parts of a step. Default: half a period of the mode, averaged between the
    free arm (found by the calibrations frequency_response and output_timing) and the arm that
    presses the part.
    """
    on_silence: Literal["safe", "holds", "unstated"] = "unstated"
    """Behaviour of the hardware if its host stops sending: the voltage goes to a safe value, or
    stays at the last one.
    """
    options: Options = Field(default_factory=Options)
    """Options of this driver."""
