"""Keyence LK-G5000 laser displacement sensor over RS-232 (the paper's head is the LK-H055).

From the RS-232 command reference of its user's manual: 8N1, no flow control, lines end with CR;
``MS,nn`` answers ``MS,nn,value`` with 8 characters, sign and point included; ``XXXXXXXX`` is an
invalid reading, ``±FFFFFFF`` over range; ``ER,command,code`` an error; ``R0`` requests measuring
mode and answers ``ER,R0,01`` if it is active already. Lines that begin with ``TG,`` are unsolicited
and are skipped. ``MM,`` with a mask of twelve digits reads several outputs and repeats the mask.

The unit is not transmitted: it is that of the display. The display also determines the place of the
decimal point, which it omits for whole units. One step of the last digit, in the unit of the rig
file, must be within ``FINEST_UM`` and ``COARSEST_UM``, and must not change while the sensor is
open. So a display that is too coarse is rejected at the first reading. A display of the usual
resolution is also rejected if it shows mm but is read as µm, or the reverse. A display in mm with
one to three decimals cannot be distinguished from one in µm by its values. A person must also
compare zero, scaling, direction and averaging.

Assumed: a change of mode takes one second, and the error codes of the LK-G5000, of which only the
numbers are known, have the meanings of those of the LK-G3000, in the same order.
"""

import logging
import re
import time
from dataclasses import dataclass
from functools import cache
from typing import Literal

from pydantic import Field

from pincette.config import Sensor, Table
from pincette.instruments.link import exchange_s, open_link
from pincette.instruments.options import read_options
from pincette.instruments.protocols import InstrumentError, Link, Timing

MET = False
"""True if this driver has been tested with its instrument."""
URL = "/dev/ttyUSB0"
"""Typical url of the instrument."""
MODE_CHANGE_S = 1.0
VALUE = re.compile(rb"[+-](?=.{7}$)\d+(?:\.(\d*))?")
COARSEST_UM, FINEST_UM = 0.1, 0.001
"""Limits of one step of the display, in µm. Coarser steps hide the motion; no display has finer
ones."""
UM_PER_UNIT = {"um": 1.0, "mm": 1000.0}
UNITS = {"um": "µm", "mm": "mm"}
MEANINGS = (
    "unknown command",
    "not in this mode",
    "wrong length",
    "wrong number of parameters",
    "parameter out of range",
    "timeout inside the instrument",
    "other error",
)
ERRORS = {
    **dict(zip((b"00", b"01", b"20", b"21", b"22", b"88", b"99"), MEANINGS, strict=True)),
    **dict(zip((b"50", b"51", b"60", b"61", b"62", b"88", b"99"), MEANINGS, strict=True)),
}
"""Meanings of the error codes of the LK-G3000 and the LK-G5000."""
REQUEST = "MS,{output:02d}"
SEVERAL = "MM,{mask}"
"""Command that reads the outputs whose digit in the mask is 1. The answer repeats the mask."""
OUTPUTS = 12
LONGEST_REPLY = "MS,01,+0000.00"

_log = logging.getLogger(__name__)


class KeyenceOptions(Table):
    """Options: output, unit of its display, and baud rate."""

    output: int = Field(default=1, ge=1, le=12)
    """Output of the controller, counted from 1."""
    unit: Literal["um", "mm"] = "um"
    """Unit of the display of the output."""
    baud: Literal[9600, 19200, 38400, 57600, 115200] = 115200
    """Baud rate of the serial line."""


@dataclass(slots=True)
class KeyenceLKG:
    """One output of the controller."""

    link: Link
    request: bytes
    unit: Literal["um", "mm"]
    _decimals: int | None = None
    """Number of digits after the point in the first reading; None before it."""

    def read_um(self) -> float:
        """Return the position in µm as the display shows it.

        Raises
        ------
        InstrumentError
            If the reading is over range or invalid, the instrument reports an error, or its
            display is not set as in the rig file.
        """
        value = self._value()
        if match := VALUE.fullmatch(value):
            decimals = len(match[1] or b"")
            if decimals != self._decimals:
                self._require_display(decimals, value)
            return float(value) * UM_PER_UNIT[self.unit]
        if value in (b"+FFFFFFF", b"-FFFFFFF"):
            side = "above" if value[:1] == b"+" else "below"
            text = f"Keyence: {side} the measuring range ({value.decode()})"
            raise InstrumentError(text, "out_of_range")
        if value == b"XXXXXXXX":
            text = "Keyence: invalid reading (XXXXXXXX); is the target in view?"
            raise InstrumentError(text, "invalid")
        raise InstrumentError(f"Keyence: {value[:40]!r} is not a value of 8 characters", "garbled")

    def check_display(self) -> None:
        """Compare unit and step of the display with the rig file, if the display shows a value.

        Raises
        ------
        InstrumentError
            If the display is not set as in the rig file, or nothing answers.
        """
        value = self._value()
        if match := VALUE.fullmatch(value):
            self._require_display(len(match[1] or b""), value)

    def _value(self) -> bytes:
        reply = self.link.exchange(self.request)
        echo, value = reply[: len(self.request)], reply[len(self.request) + 1 :]
        if echo != self.request or reply[len(echo) : len(echo) + 1] != b",":
            raise _refusal(self.request, reply)
        return value

    def _require_display(self, decimals: int, value: bytes) -> None:
        """Raise InstrumentError if the display shows another unit or step than configured."""
        step_um = UM_PER_UNIT[self.unit] * 10.0**-decimals
        shown = value.decode()
        remedy = (
            "set the minimum display unit of this output to 0.01 µm or 0.00001 mm at the "
            'controller, and [sensor.options] unit = "um" or "mm" to match'
        )
        if not 0.999 * FINEST_UM < step_um < 1.001 * COARSEST_UM:  # steps are powers of ten
            text = (
                f"Keyence: the value {shown}, in {UNITS[self.unit]} by the rig file, has steps of "
                f"{step_um:g} µm, limits {FINEST_UM:g} and {COARSEST_UM:g} µm: {remedy}"
            )
            raise InstrumentError(text, "refused")
        if self._decimals is not None:
            text = (
                f"Keyence: the value {shown} has {decimals} decimals, the first one had "
                f"{self._decimals}: the display setting was changed while it was read; "
                "change it back, or restart the program"
            )
            raise InstrumentError(text, "refused")
        self._decimals = decimals

    def close(self) -> None:
        """Close the port."""
        self.link.close()


def _refusal(request: bytes, reply: bytes) -> InstrumentError:
    head, _, code = reply.rpartition(b",")
    if head == b"ER," + request.split(b",")[0]:
        meaning = ERRORS.get(code, "no meaning known")
        code_text = code[:8].decode("ascii", "backslashreplace")
        text = f"Keyence: {request!r} refused, error {code_text} ({meaning})"
        return InstrumentError(text, "refused")
    text = f"Keyence: {reply[:40]!r} is not an answer to {request!r}"
    return InstrumentError(text, "garbled")


def solicited(line: bytes) -> bool:
    """Return whether a line can be an answer to a request."""
    return not line.startswith(b"TG,")


@cache
def answers(request: bytes) -> re.Pattern[bytes]:
    """Return the pattern of the answers to a request: its echo, or an error that names it."""
    command = re.escape(request.split(b",")[0])
    value = b",.*" if b"," in request else b""
    return re.compile(re.escape(request) + value + b"|ER," + command + b",.*", re.DOTALL)


def timing(settings: Sensor) -> Timing:
    """Return the time of one reading on the line: bytes at ten bits each over the baud rate.

    Raises
    ------
    ConfigError
        If an option is unknown or impossible.
    """
    options = read_options(KeyenceOptions, "keyence_lkg", settings.options)
    count = len(_request(options)) + len(LONGEST_REPLY) + 2
    note = "no averaging is assumed; a moving average that is set at the instrument delays it more"
    return Timing(exchange_s(count, options.baud), note=note)


def open_sensor(settings: Sensor, link: Link | None = None) -> KeyenceLKG:
    """Open the port, or use ``link``, start the measuring mode, and check the display.

    When a lost port is opened again, the instrument may already be in measuring mode; otherwise the
    mode is requested, and the next exchanges allow for the time that the change takes.

    Raises
    ------
    ConfigError
        If an option is unknown or impossible.
    InstrumentError
        If the port cannot be opened or the instrument does not answer as it should.
    """
    options = read_options(KeyenceOptions, "keyence_lkg", settings.options)
    if link is None:
        if not MET:
            _log.warning(
                "keyence_lkg has not been tested with its instrument: it is written from the manual"
            )
        link = open_link(
            settings.url,
            baud=options.baud,
            timeout_s=settings.timeout_s,
            accept=solicited,
            answers=answers,
            probes=(b"R0", _several(options)),
            on_open=_measure_again,
            record=settings.record,
        )
    sensor = KeyenceLKG(link, _request(options), options.unit)
    try:
        if _change_to_measuring(link):
            time.sleep(MODE_CHANGE_S)
        sensor.check_display()
    except InstrumentError:
        link.close()
        raise
    return sensor


def _request(options: KeyenceOptions) -> bytes:
    return REQUEST.format(output=options.output).encode()


def _several(options: KeyenceOptions) -> bytes:
    """Return the request that reads the same output by the command for several outputs."""
    mask = "".join("01"[number == options.output] for number in range(1, OUTPUTS + 1))
    return SEVERAL.format(mask=mask).encode()


def _change_to_measuring(link: Link) -> bool:
    """Request the measuring mode; return True if the instrument had another mode before."""
    reply = link.exchange(b"R0")
    if reply not in (b"R0", b"ER,R0,01"):
        raise _refusal(b"R0", reply)
    return reply == b"R0"


def _measure_again(link: Link) -> None:
    if _change_to_measuring(link):
        text = f"Keyence: changing to measuring mode, {MODE_CHANGE_S} s; was it set up by hand?"
        raise InstrumentError(text, "refused")
