"""A position sensor's monitor output on an analog input of NI-DAQmx: options, timing, opening.

The position is offset_um + um_per_V · voltage. Outside captures the channel is read on demand; a
capture samples it together with the drive voltage at the amplifier's input, on the device's own
clock. The url is ``ni:DEVICE/CHANNEL`` for this machine's driver,
``grpc://host:port/DEVICE/CHANNEL`` for an NI gRPC Device Server.
"""

from typing import Annotated

from pydantic import AfterValidator, Field

from pincette.config import Sensor, Table
from pincette.config.tables import Positive
from pincette.instruments.options import read_options
from pincette.instruments.protocols import BufferedSensor, InstrumentError, Link, Timing
from pincette_nidaqmx.channel import EXCHANGE_S, channel_of, needing_the_package

MET = False
"""True if this driver has been tested with its instrument."""
URL = "ni:cDAQ1Mod1/ai0"
"""Typical url of the instrument."""
NOTE = "an exchange of 1 ms is assumed unless stated, and a monitor output without delay"


def _not_zero(value: float) -> float:
    if value == 0.0:
        raise ValueError("it must not be 0")
    return value


class NidaqmxInputOptions(Table):
    """Scale of the monitor output, and the channel that measures the drive."""

    um_per_V: Annotated[float, AfterValidator(_not_zero)]
    """Scale of the monitor output in µm/V, as set at the sensor; negative if the voltage falls."""
    offset_um: float = 0.0
    """Position at 0 V, in µm."""
    drive_channel: str = ""
    """Analog input at the amplifier's input, as cDAQ1Mod1/ai1; without it no capture is possible.
    """
    least_V: float = -10.0
    """Lowest voltage of the input's range, in V."""
    most_V: float = 10.0
    """Highest voltage of the input's range, in V."""
    average: int = Field(default=1, ge=1, le=1000)
    """Number of samples that a single reading averages."""
    rate_hz: Positive = 50_000.0
    """Highest rate of a capture, in Hz; assumed."""
    channel: str = ""
    """Physical channel, if the url names none."""
    exchange_s: Positive = EXCHANGE_S
    """Duration of a call, in s; measure it if the period is short."""


def timing(settings: Sensor) -> Timing:
    """Return the time of one reading, and the highest rate of a capture; raises ConfigError."""
    options = read_options(NidaqmxInputOptions, "nidaqmx", settings.options)
    captures_hz = options.rate_hz if options.drive_channel else None
    return Timing(options.exchange_s, buffered_hz=captures_hz, note=NOTE)


def open_sensor(settings: Sensor, link: Link | None = None) -> BufferedSensor:
    """Open the connection to the device, or use ``link``, and create the task for single readings.

    Raises
    ------
    ConfigError
        If an option is unknown or impossible, or no channel is named.
    InstrumentError
        If the package or the driver is not installed, or the device does not answer as it
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
