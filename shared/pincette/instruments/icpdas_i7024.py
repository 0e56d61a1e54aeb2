"""ICP DAS I-7024 analog output module, ±10 V, 14 bit, over RS-485 with the DCON protocol.

From the I-7021/7022/7024 user manual: lines end with CR; ``#AAN±dd.ddd`` sets channel N of the
module at address AA (hexadecimal) and answers ``>``; ``?`` is a value out of range, ``?AA`` an
invalid command, ``!`` a command ignored because the host watchdog has tripped and the output is at
its safe value; ``$AA8N`` answers ``!AA±dd.ddd``, the output voltage. A wrong address or a bad line
gets no answer. An optional checksum, two hexadecimal digits, is the sum of the preceding bytes
modulo 256.

``$AA2`` answers ``!AATTCCFF``: output range, line speed, and data format with slew rate. The driver
needs ±10 V (33), immediate changes and engineering units. It rejects any other setting before it
moves anything, since the module would confirm the same commands with another meaning.

The host watchdog: ``~AA3EVV`` switches it on (E = 1) or off, VV in tenths of a second in
hexadecimal; ``~**`` is the heartbeat of the host, and has no answer; ``~AA0`` answers ``!AASS``,
the status; ``~AA1`` clears it; ``~AA5N`` makes the present output the safe value. Assumed: bit 2 of
the status is the trip, and a heartbeat has a checksum if lines do.
"""

import logging
from collections.abc import Callable
from functools import partial
from math import isfinite
from typing import Literal

from pydantic import Field

from pincette.config import Output, Table
from pincette.instruments.icpdas.dcon import DconModule, answers, probes
from pincette.instruments.icpdas.host_watchdog import TICK_S, HostWatchdog
from pincette.instruments.link import exchange_s, open_link
from pincette.instruments.options import read_options
from pincette.instruments.protocols import InstrumentError, Link, Timing

MET = False
"""True if this driver has been tested with its instrument."""
URL = "/dev/ttyUSB1"
"""Typical url of the instrument."""
LIMIT_V = 10.0
STEP_V = 20.0 / 2**14
"""Voltage step of 14 bits over ±10 V; commands in whole mV can distinguish all steps."""
RESPONSE_S = 0.010
LONGEST_WATCHDOG_S = 25.5

_log = logging.getLogger(__name__)


class I7024Options(Table):
    """Options of the module: address, channel, checksum, baud rate, and watchdog time."""

    address: int = Field(default=1, ge=0, le=255)
    """Address of the module on its line."""
    channel: int = Field(default=0, ge=0, le=3)
    """Channel of the module, counted from 0."""
    checksum: bool = False
    """True if lines end with a checksum; must agree with the setting of the module."""
    baud: Literal[1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200] = 115200
    """Baud rate of the serial line."""
    watchdog_s: float = Field(default=0.5, ge=0.0, le=LONGEST_WATCHDOG_S, multiple_of=0.1)
    """Time limit of the host watchdog, in s; 0 leaves the watchdog unchanged."""

    def module(self, link: Link) -> DconModule:
        """Return the module with these options on a line."""
        return DconModule(link, self.address, self.channel, checksum=self.checksum)


class I7024:
    """One channel of the module; with a watchdog, each write sends the heartbeat first."""

    def __init__(
        self, options: I7024Options, connect: Callable[[Callable[[Link], None]], Link]
    ) -> None:
        self._link = connect(self._resume)
        self._module = options.module(self._link)
        self._watchdog = HostWatchdog(self._module, options.watchdog_s)
        try:
            self._module.identify()
            self._watchdog.take_over()
        except InstrumentError:
            self._link.close()
            raise

    def write_V(self, voltage_V: float) -> None:
        """Apply a voltage, rounded to 1 mV; returns when the module has accepted it.

        Raises
        ------
        InstrumentError
            If the voltage is not a number within ±10 V, before anything is sent; if the
            module refuses it, has tripped, or does not answer.
        """
        if not isfinite(voltage_V) or abs(voltage_V) > LIMIT_V:
            text = f"I-7024: {voltage_V} V refused, limit ±{LIMIT_V} V"
            raise InstrumentError(text, "misused")
        self._watchdog.feed_with_write()
        try:
            self._module.put_out(voltage_V)
        except InstrumentError as error:
            self._watchdog.learn(error.code)
            raise
        self._watchdog.learn(None)

    def read_V(self) -> float:
        """Return the present output voltage of the channel in V.

        Raises
        ------
        InstrumentError
            If the module does not answer, or not with a voltage.
        """
        return self._module.read_V()

    def keep_alive(self) -> None:
        """Send the heartbeat to the module; raises InstrumentError."""
        self._watchdog.feed()

    def clear_trip(self) -> None:
        """Let the module accept commands again after its watchdog has tripped; moves nothing.

        Only for a reset by a person. Earlier commands are outdated: begin from the voltage of
        ``read_V``.
        """
        self._watchdog.clear()

    def close(self) -> None:
        """Switch the watchdog off and close the port; the output keeps its voltage."""
        self._watchdog.leave()
        self._link.close()

    def _resume(self, _link: Link) -> None:
        self._module.identify()
        self._watchdog.resume()


def timing(settings: Output) -> Timing:
    """Return the time of one write with heartbeat and checksums, and the response of the output.

    Each byte takes ten bits at the baud rate; the response is the value of the manual, to 5 %.

    Raises
    ------
    ConfigError
        If an option is unknown or impossible.
    """
    options = read_options(I7024Options, "icpdas_i7024", settings.options)
    count = DconModule.write_bytes(checksum=options.checksum)
    lets_go_s = None
    if options.watchdog_s > 0.0:
        count += HostWatchdog.heartbeat_bytes(checksum=options.checksum)
        # The module counts whole ticks, and the first tick may have been nearly over when the count
        # began.
        lets_go_s = options.watchdog_s - TICK_S
    return Timing(exchange_s(count, options.baud), RESPONSE_S, lets_go_s=lets_go_s)


def open_output(settings: Output, link: Link | None = None) -> I7024:
    """Open the port, or use ``link``, and check that the module answers; moves nothing.

    With a watchdog, an earlier trip is cleared, 0 V is made the safe value if the output is at 0 V,
    and the watchdog runs from the first heartbeat on: ``write_V`` or ``keep_alive``.

    Raises
    ------
    ConfigError
        If an option is unknown or impossible.
    InstrumentError
        If the port cannot be opened or the module does not answer as it should.
    """
    options = read_options(I7024Options, "icpdas_i7024", settings.options)

    def connect(on_open: Callable[[Link], None]) -> Link:
        if link is not None:
            return link
        if not MET:
            _log.warning(
                "icpdas_i7024 has not been tested with its instrument: it is written from "
                "the manual"
            )
        return open_link(
            settings.url,
            baud=options.baud,
            timeout_s=settings.timeout_s,
            answers=partial(answers, checksum=options.checksum),
            probes=probes(options.address, checksum=options.checksum),
            on_open=on_open,
            record=settings.record,
        )

    return I7024(options, connect)
