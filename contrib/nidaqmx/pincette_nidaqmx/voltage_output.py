"""An analog output of NI-DAQmx, as the NI-9263 (±10 V, 16 bit): options, timing, opening.

The url is ``ni:DEVICE/CHANNEL`` for this machine's driver, ``grpc://host:port/DEVICE/CHANNEL`` for
an NI gRPC Device Server.

An analog output cannot be read back. If the voltage is also connected to an analog input, or the
device measures it internally (M series: ``Dev1/_ao0_vs_aognd``), that input is ``read_channel``; it
must be on another device than the position input, which is in use. Without it the voltage before
the first write is *assumed* to be ``found_V``, with a warning. The default of 0 V is right after
power-on. It is wrong after a crash of an earlier program, since the module holds its last voltage.
The module has no known watchdog.
"""

from pydantic import model_validator

from pincette.config import Output, Table
from pincette.config.tables import Positive
from pincette.instruments.options import read_options
from pincette.instruments.protocols import InstrumentError, Link, Timing, WaveOutput
from pincette_nidaqmx.channel import EXCHANGE_S, channel_of, needing_the_package

MET = False
"""True if this driver has been tested with its instrument."""
URL = "ni:cDAQ1Mod2/ao0"
"""Typical url of the instrument."""
STEP_V = 20.0 / 2**16
"""Voltage step of 16 bits over ±10 V."""
SETTLING_S = 3e-6
PARTS_CALLS = 3
"""Number of calls needed for a step that is written in parts: stop, write, start."""
NOTE = (
    "an exchange of 1 ms unless stated, settling in 3 µs and waves at the stated rate are assumed"
)


class NidaqmxOutputOptions(Table):
    """Range of the output, and the source of its voltage before the first write."""

    least_V: float = -10.0
    """Lowest voltage of the output's range, in V."""
    most_V: float = 10.0
    """Highest voltage of the output's range, in V."""
    read_channel: str = ""
    """Analog input that measures the output, as Dev1/_ao0_vs_aognd; read once, at opening."""
    found_V: float = 0.0
    """Voltage in V that is assumed before the first write, if there is no ``read_channel``."""
    rate_hz: Positive = 50_000.0
    """Highest rate of a waveform, in Hz; assumed."""
    channel: str = ""
    """Physical channel, if the url names none."""
    exchange_s: Positive = EXCHANGE_S
    """Duration of a call, in s; measure it if the period is short."""

    @model_validator(mode="after")
    def _ordered(self) -> "NidaqmxOutputOptions":
        if not self.least_V <= self.found_V <= self.most_V:
            raise ValueError(
                f"found_V = {self.found_V} V is not within {self.least_V} V and {self.most_V} V"
            )
        return self


def timing(settings: Output) -> Timing:
    """Return the time of one write, settling, and the highest rate of a waveform.

    Raises ConfigError.
    """
    options = read_options(NidaqmxOutputOptions, "nidaqmx", settings.options)
    calls = PARTS_CALLS if settings.shaping else 1
    return Timing(calls * options.exchange_s, SETTLING_S, options.rate_hz, NOTE)


def open_output(settings: Output, link: Link | None = None) -> WaveOutput:
    """Open the connection to the device, or use ``link``, and create its tasks; nothing moves.

    Raises
    ------
    ConfigError
        If an option is unknown or impossible, or no channel is named.
    InstrumentError
        If the package or the driver is not installed, or the device does not answer as it
        should.
    """
    options = read_options(NidaqmxOutputOptions, "nidaqmx", settings.options)
    channel = channel_of(settings.url, options.channel)
    with needing_the_package(settings.url):
        from pincette_nidaqmx.analog_output import AnalogOutput
        from pincette_nidaqmx.tasks import open_daq
    daq = open_daq(settings, channel, link, MET)
    output = AnalogOutput(
        daq, least_V=options.least_V, most_V=options.most_V, rate_hz=options.rate_hz
    )
    try:
        output.prepare(options.read_channel, options.found_V)
    except InstrumentError:
        daq.close()
        raise
    return output
