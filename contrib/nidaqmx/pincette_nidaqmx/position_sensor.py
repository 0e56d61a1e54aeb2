"""A position sensor's monitor output on an analog input of NI-DAQmx: options, timing, opening.

The position is offset_um + um_per_V · voltage. Outside captures the channel is read on demand; a
capture samples it together with the drive at the amplifier's input, on the device's own clock. The
url is ``ni:DEVICE/CHANNEL`` for this machine's driver, ``grpc://host:port/DEVICE/CHANNEL`` for an
NI gRPC Device Server.
"""

from typing import Annotated

from pydantic import AfterValidator, Field

from pincette.config import Sensor, Table
from pincette.config.tables import Positive
from pincette.instruments.options import read_options
from pincette.instruments.protocols import BufferedSensor, InstrumentError, Link, Timing
from pincette_nidaqmx.channel import EXCHANGE_S, channel_of, needing_the_package

MET = False
"""Whether this driver has met its instrument."""
URL = "ni:cDAQ1Mod1/ai0"
"""Where it usually is."""
NOTE = "an exchange of 1 ms is assumed unless stated, and a monitor output without delay"


def _not_zero(value: float) -> float:
    if value == 0.0:
        raise ValueError("it must not be 0")
    return value


class NidaqmxInputOptions(Table):
    """The monitor's scale, and where the drive is measured."""

    um_per_V: Annotated[float, AfterValidator(_not_zero)]
    """Of the monitor output, as set at the sensor; negative where the voltage falls."""
    offset_um: float = 0.0
    """Position at 0 V."""
    drive_channel: str = ""
    """Analog input at the amplifier's input, as in cDAQ1Mod1/ai1; without it, no capture."""
    least_V: float = -10.0
    """Lowest voltage of the input's range."""
    most_V: float = 10.0
    """Highest voltage of the input's range."""
    average: int = Field(default=1, ge=1, le=1000)
    """Samples of a single reading."""
    rate_hz: Positive = 50_000.0
    """Highest rate of a capture; assumed."""
    channel: str = ""
    """Physical channel, where the url names none."""
    exchange_s: Positive = EXCHANGE_S
    """Time of a call; measure it where the period is short."""


def timing(settings: Sensor) -> Timing:
    """Time of one reading, and the highest rate of a capture; raises ConfigError."""
    options = read_options(NidaqmxInputOptions, "nidaqmx", settings.options)
    captures_hz = options.rate_hz if options.drive_channel else None
    return Timing(options.exchange_s, buffered_hz=captures_hz, note=NOTE)


def open_sensor(settings: Sensor, link: Link | None = None) -> BufferedSensor:
    """Open the way to the device, or take ``link``, and make the task of the single readings.

    Raises
    ------
    ConfigError
        Where an option is unknown or impossible, or no channel is named.
    InstrumentError
        Where the package or the driver is not installed, or the device does not answer as it
        should.
    """
    options = read_options(NidaqmxInputOptions, "nidaqmx", settings.options)
    channel = channel_of(settings.url, options.channel)
    with needing_the_package(settings.url):
        from pincette_nidaqmx.analog_input import AnalogInput, Scale
        from pincette_nidaqmx.tasks import open_daq
    daq = open_daq(settings, channel, link, MET)
    sensor = AnalogInput(
        daq,
        Scale(options.um_per_V, options.offset_um, options.least_V, options.most_V),
        drive_channel=options.drive_channel,
        average=options.average,
        rate_hz=options.rate_hz,
    )
    try:
        sensor.prepare()
    except InstrumentError:
        daq.close()
        raise
    return sensor
