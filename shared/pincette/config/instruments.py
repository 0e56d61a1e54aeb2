"""The two instruments of a rig: which driver, where, and within which range."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.config.tables import NotNegative, Positive, Table, Url

Options = dict[str, str | int | float | bool]
"""What only one driver understands; it checks them itself."""
SerialNumber = Annotated[str, Field(max_length=60)]
"""Of an instrument, as its plate has it; empty: not known."""


class Sensor(Table):
    """The position sensor: driver, where it is, its range in µm."""

    driver: str
    """As ``pincette drivers`` lists it."""
    url: Url
    """A device, ``socket://HOST:PORT``, or what the driver says."""
    serial_number: SerialNumber = ""
    """Of the instrument; noted with what is calibrated."""
    minimum_um: float
    """A reading below is no measurement."""
    maximum_um: float
    """A reading above is no measurement."""
    offset_um: float = 0.0
    """Subtracted from the reading, so that the arm at rest is near zero."""
    direction: Literal[1, -1] = 1
    """+1 where closing the gripper raises the reading."""
    timeout_s: Positive = 0.1
    """Of a whole exchange with the instrument."""
    noise_um: NotNegative
    """r.m.s., as identified; enters the force uncertainty."""
    record: str | None = None
    """File that every byte to and from the instrument is written to."""
    options: Options = Field(default_factory=Options)
    """What this driver alone understands."""


class Output(Table):
    """The voltage output that drives the amplifier."""

    driver: str
    """As ``pincette drivers`` lists it."""
    url: Url
    """A device, ``socket://HOST:PORT``, or what the driver says."""
    serial_number: SerialNumber = ""
    """Of the instrument; noted with what is calibrated."""
    timeout_s: Positive = 0.1
    """Of a whole exchange with the instrument."""
    record: str | None = None
    """File that every byte to and from the instrument is written to."""
    on_silence: Literal["safe", "holds", "unstated"] = "unstated"
    """What the hardware does by itself where its host falls silent: go to a safe value, or hold."""
    options: Options = Field(default_factory=Options)
    """What this driver alone understands."""
