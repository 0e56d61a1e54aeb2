"""The two instruments of a rig: which driver, where, and within which range."""

from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field

from pincette.config.tables import NotNegative, Positive, Table

NO_RFC2217 = (
    "rfc2217:// is not supported, since opening such a port and changing its settings block for "
    "seconds; set the baud rate at the device server, configure a raw TCP port there, and use "
    "socket://HOST:PORT"
)


def _reachable(url: str) -> str:
    """A url that a link can open, its scheme in small letters: a device, or a host and port."""
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
    raise ValueError("wanted socket://HOST:PORT with a port from 1 to 65535, or a device")


Url = Annotated[str, AfterValidator(_reachable)]
Options = dict[str, str | int | float | bool]
"""What only one driver understands; it checks them itself."""
SerialNumber = Annotated[str, Field(max_length=60)]
"""Of an instrument, as on its name plate; empty: not known."""


class Sensor(Table):
    """The position sensor: driver, where it is, its range in µm."""

    driver: str
    """Name as listed by ``pincette doctor --drivers``."""
    url: Url
    """A device, ``socket://HOST:PORT``, or the form that the driver documents."""
    serial_number: SerialNumber = ""
    """Of the instrument; stored with each calibration."""
    minimum_um: float
    """A reading below this value is invalid."""
    maximum_um: float
    """A reading above this value is invalid."""
    offset_um: float = 0.0
    """Subtracted from the reading, so that the arm at rest is near zero."""
    direction: Literal[1, -1] = 1
    """+1 if closing the gripper raises the reading."""
    timeout_s: Positive = 0.1
    """Longest exchange with the instrument; in real time at most 0.8 of a control period."""
    noise_um: NotNegative
    """r.m.s., as identified; enters the force uncertainty."""
    drift_um_per_min: NotNegative = 0.0
    """Largest drift of the reading, as with the temperature of the room; it enters the force
    uncertainty with the age of the zero. 0: none is assumed. The calibration ``noise`` measures
    it at rest."""
    record: str | None = None
    """File that every byte to and from the instrument is written to."""
    options: Options = Field(default_factory=Options)
    """Options of this driver."""


class Output(Table):
    """The voltage output that drives the amplifier."""

    driver: str
    """Name as listed by ``pincette doctor --drivers``."""
    url: Url
    """A device, ``socket://HOST:PORT``, or the form that the driver documents."""
    serial_number: SerialNumber = ""
    """Of the instrument; stored with each calibration."""
    timeout_s: Positive = 0.1
    """For a whole exchange with the instrument."""
    record: str | None = None
    """File that every byte to and from the instrument is written to."""
    step_V: NotNegative = 0.0
    """Smallest step of the voltage, as 20 V/2^14 of 14 bits over ±10 V; 0: not known.

    Only its multiples are put out then. The arm remembers what was truly put out: where the output
    rounds by itself, the free response errs by more after each small to-and-fro."""
    shaping: bool = False
    """Write each step of the voltage in three parts (1/4, 1/2, 1/4), which leaves the mode of the
    arm at rest. For outputs that time the parts by a clock of their own, as "nidaqmx"."""
    shaping_interval_s: Positive | None = None
    """Time from one part of a step to the next. Left out: half a period of the mode, half-way
    between that of the free arm, which the calibrations frequency_response and output_timing find,
    and that of the arm which presses the part."""
    on_silence: Literal["safe", "holds", "unstated"] = "unstated"
    """What the hardware does by itself if its host stops sending: go to a safe value, or hold."""
    options: Options = Field(default_factory=Options)
    """Options of this driver."""
