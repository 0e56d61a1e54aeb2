"""ICP DAS I-7024 analog output module, ±10 V, 14 bit, over RS-485 with the DCON protocol.

From the I-7021/7022/7024 user manual: lines end with CR; ``#AAN±dd.ddd`` sets channel N of the
module at address AA (hexadecimal) and answers ``>``; ``?`` is a value out of range, ``?AA`` an
invalid command, ``!`` a command ignored because the host watchdog has tripped and the output is
at its safe value; ``$AA8N`` answers ``!AA±dd.ddd``, the voltage that is put out. A wrong address
or a bad line is met with silence. An optional checksum, two hexadecimal digits, is the sum of the
preceding bytes modulo 256.
"""

import logging
import re
from dataclasses import dataclass
from math import isfinite
from typing import Literal

from pydantic import Field

from pincette.config import Output, Table
from pincette.instruments.link import open_link
from pincette.instruments.options import read_options
from pincette.instruments.protocols import InstrumentError, Link

MET = False
"""Whether this driver has met its instrument."""
LIMIT_V = 10.0
VALUE = re.compile(rb"[+-]\d{2}\.\d{3}")

_log = logging.getLogger(__name__)


class I7024Options(Table):
    """Address of the module, its channel, whether lines carry a checksum, the line's speed."""

    address: int = Field(default=1, ge=0, le=255)
    channel: int = Field(default=0, ge=0, le=3)
    checksum: bool = False
    baud: Literal[1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200] = 115200


@dataclass(frozen=True, slots=True)
class I7024:
    """One channel of the module."""

    link: Link
    head: bytes
    checksum: bool

    def write_V(self, voltage_V: float) -> None:
        """Put out a voltage, rounded to 1 mV; returns when the module has accepted it.

        Raises
        ------
        InstrumentError
            Where the voltage is not a number within ±10 V, before anything is sent; where the
            module refuses it, has tripped, or does not answer.
        """
        if not isfinite(voltage_V) or abs(voltage_V) > LIMIT_V:
            raise InstrumentError(f"I-7024: {voltage_V} V refused, limit ±{LIMIT_V} V")
        request = self.head + f"{voltage_V:+07.3f}".encode()
        reply = self.ask(request)
        if reply != b">":
            raise InstrumentError(f"I-7024: {voltage_V:+.3f} V {_meaning(self.head, reply)}")

    def read_V(self) -> float:
        """Return the voltage that the channel puts out now.

        Raises
        ------
        InstrumentError
            Where the module does not answer, or not with a voltage.
        """
        address, channel = self.head[1:3], self.head[3:]
        reply = self.ask(b"$" + address + b"8" + channel)
        if reply[:3] != b"!" + address or VALUE.fullmatch(reply[3:]) is None:
            raise InstrumentError(f"I-7024: {reply[:40]!r} carries no voltage")
        return float(reply[3:])

    def close(self) -> None:
        """Give the port back."""
        self.link.close()

    def ask(self, body: bytes) -> bytes:
        """Exchange one line, with its checksum where there is one; raises InstrumentError."""
        if not self.checksum:
            return self.link.exchange(body)
        signed = self.link.exchange(body + _sum(body))
        reply, given = signed[:-2], signed[-2:]
        if given != _sum(reply):
            raise InstrumentError(f"I-7024: wrong checksum in {signed[:40]!r}")
        return reply


def _meaning(head: bytes, reply: bytes) -> str:
    if reply == b"?":
        return "refused as out of range"
    if reply == b"?" + head[1:3]:
        return "refused as an invalid command; check the module's type and data format"
    if reply == b"!":
        return "ignored: the host watchdog has tripped and the output is at its safe value"
    return f"answered by {reply[:40]!r}, which means nothing here"


def _sum(body: bytes) -> bytes:
    total = 0
    for byte in body:
        total += byte
    return b"%02X" % (total % 256)


def open_output(settings: Output, link: Link | None = None) -> I7024:
    """Open the port, or take ``link``, and make sure that the module answers; moves nothing.

    Raises
    ------
    ConfigError
        Where an option is unknown or impossible.
    InstrumentError
        Where the port cannot be opened or the module does not answer as it should.
    """
    options = read_options(I7024Options, "icpdas_i7024", settings.options)
    if link is None:
        if not MET:
            _log.warning("icpdas_i7024 has not met its instrument: it is written from the manual")
        link = open_link(settings.url, baud=options.baud, timeout_s=settings.timeout_s)
    output = I7024(link, b"#%02X%d" % (options.address, options.channel), options.checksum)
    try:
        _identify(output, options.address)
    except InstrumentError:
        link.close()
        raise
    return output


def _identify(output: I7024, address: int) -> None:
    """Ask for the module's name, so that a wrong address is found before anything moves."""
    reply = output.ask(b"$%02XM" % address)
    if not reply.startswith(b"!%02X" % address):
        raise InstrumentError(f"I-7024: {reply[:40]!r} does not name a module")
