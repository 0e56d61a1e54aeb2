"""Keyence LK-G5000 laser displacement sensor over RS-232 (the paper's head is the LK-H055).

From the RS-232 command reference of its user's manual: 8N1, no flow control, lines end with CR;
``MS,nn`` answers ``MS,nn,value`` with 8 characters, sign and point included; ``XXXXXXXX`` is an
invalid reading, ``±FFFFFFF`` over range; ``ER,command,code`` an error; ``R0`` asks for measuring
mode and answers ``ER,R0,01`` where it holds. The unit is not transmitted: it is the display's.
Lines that begin with ``TG,`` come unasked and are skipped.
"""

import logging
import re
import time
from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from pincette.config import Sensor, Table
from pincette.instruments.link import open_link
from pincette.instruments.options import read_options
from pincette.instruments.protocols import InstrumentError, Link

MET = False
"""Whether this driver has met its instrument."""
MODE_CHANGE_S = 1.0
VALUE = re.compile(rb"[+-](?=.{7}$)\d+\.\d+")
UM_PER_UNIT = {"um": 1.0, "mm": 1000.0}
ERRORS = {
    b"00": "unknown command",
    b"01": "not in this mode",
    b"20": "wrong length",
    b"21": "wrong number of parameters",
    b"22": "parameter out of range",
    b"88": "timeout inside the instrument",
    b"99": "other error",
}
"""The LK-G3000 table; the LK-G5000 has 50, 51, 60, 61, 62 as well, whose meaning is unverified."""

_log = logging.getLogger(__name__)


class KeyenceOptions(Table):
    """Which output is read, in which unit its display is set, and the line's speed."""

    output: int = Field(default=1, ge=1, le=12)
    unit: Literal["um", "mm"] = "um"
    baud: Literal[9600, 19200, 38400, 57600, 115200] = 115200


@dataclass(frozen=True, slots=True)
class KeyenceLKG:
    """One output of the controller."""

    link: Link
    request: bytes
    um_per_unit: float

    def read_um(self) -> float:
        """Return the position in µm, as the display counts it.

        Raises
        ------
        InstrumentError
            Where the reading is over range or invalid, or the instrument reports an error.
        """
        reply = self.link.exchange(self.request)
        echo, value = reply[: len(self.request)], reply[len(self.request) + 1 :]
        if echo != self.request or reply[len(echo) : len(echo) + 1] != b",":
            raise _refusal(self.request, reply)
        if VALUE.fullmatch(value):
            return float(value) * self.um_per_unit
        if value in (b"+FFFFFFF", b"-FFFFFFF"):
            side = "above" if value[:1] == b"+" else "below"
            raise InstrumentError(f"Keyence: {side} the measuring range ({value.decode()})")
        if value == b"XXXXXXXX":
            raise InstrumentError("Keyence: invalid reading (XXXXXXXX); is the target in view?")
        raise InstrumentError(f"Keyence: {reply[:40]!r} carries no 8-character value")

    def close(self) -> None:
        """Give the port back."""
        self.link.close()


def _refusal(request: bytes, reply: bytes) -> InstrumentError:
    head, _, code = reply.rpartition(b",")
    if head == b"ER," + request.split(b",")[0]:
        meaning = ERRORS.get(code, "no meaning known")
        return InstrumentError(f"Keyence: {request!r} refused, error {code.decode()} ({meaning})")
    return InstrumentError(f"Keyence: {reply[:40]!r} is no answer to {request!r}")


def _solicited(line: bytes) -> bool:
    return not line.startswith(b"TG,")


def open_sensor(settings: Sensor, link: Link | None = None) -> KeyenceLKG:
    """Open the port, or take ``link``, and bring the instrument to measuring mode.

    Raises
    ------
    ConfigError
        Where an option is unknown or impossible.
    InstrumentError
        Where the port cannot be opened or the instrument does not answer as it should.
    """
    options = read_options(KeyenceOptions, "keyence_lkg", settings.options)
    if link is None:
        if not MET:
            _log.warning("keyence_lkg has not met its instrument: it is written from the manual")
        link = open_link(
            settings.url, baud=options.baud, timeout_s=settings.timeout_s, accept=_solicited
        )
    try:
        _measure_from_here(link)
    except InstrumentError:
        link.close()
        raise
    return KeyenceLKG(link, b"MS,%02d" % options.output, UM_PER_UNIT[options.unit])


def _measure_from_here(link: Link) -> None:
    reply = link.exchange(b"R0")
    if reply == b"R0":
        time.sleep(MODE_CHANGE_S)
    elif reply != b"ER,R0,01":
        raise _refusal(b"R0", reply)
