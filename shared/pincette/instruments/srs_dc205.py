"""Stanford Research Systems DC205 voltage source: ±1, ±10 or ±100 V, over USB or RS-232.

From chapter 3 of its operation and service manual (revision 0.30): 8N1, lines end with LF after
``TERM LF``, ``;`` separates the commands of one line, and the answers to its queries. ``VOLT
1.234567`` sets the voltage, ``SOUT 1`` switches the output on, ``RNGE RANGE10`` sets the range,
only while the output is off. Settings have no reply: ``LEXE?;LCME?`` answers ``0;0``, the last
execution and command error, cleared by reading. USB is fixed at 115200 baud; RS-232 starts at 9600,
at which a write lasts 40 ms and misses T = 20 ms.

From public drivers, not seen in the manual: the execution errors' meanings, and that ``VOLT?`` is
the setting, not a measurement. Unverified: how fast the output may be updated and settles, the
resolution within a range, whether an overload is latched, what the terminals do while the output
is off (0 V is assumed). The ±100 V range needs the instrument's interlock closed.

The instrument has no known watchdog: if the program or the host dies, the last voltage stays.
"""

import logging
import re
from collections.abc import Callable
from functools import cache
from math import isfinite
from typing import Literal

from pincette.config import Output, Table
from pincette.instruments.link import exchange_s, open_link
from pincette.instruments.options import read_options
from pincette.instruments.protocols import InstrumentError, Link, Timing

MET = False
"""True if this driver has been tested with its instrument."""
URL = "/dev/ttyUSB1"
"""Typical url of the instrument."""
VALUE = re.compile(rb"[+-]?\d{1,3}(\.\d{1,9})?(E[+-]?\d{1,2})?")
CODE = re.compile(rb"\d{1,3}")
SETTING = b"VOLT %.6f"
QUERY = re.compile(rb"(\*?[A-Z]+)\?")
TOKEN = b"[A-Z0-9]+"
ANSWERS = {
    b"*IDN": b"[^;]*,[^;]*",
    b"VOLT": VALUE.pattern,
    b"LEXE": CODE.pattern,
    b"LCME": CODE.pattern,
}
"""Pattern of the answer to a query; the answer to another command is a token."""
PROBES = (b"*IDN?", b"VOLT?;RNGE?;SOUT?;OVLD?")
"""Queries whose answers differ from all others: only the first answer contains commas, and only the
second has four words."""
RANGES = {1: b"RANGE1", 10: b"RANGE10", 100: b"RANGE100"}
SWITCH = (b"OFF", b"ON")
LOAD = (b"OKAY", b"OVLD")
"""Tokens in the order of their numbers. The instrument sends token or number, depending on TOKN."""
EXECUTION_ERRORS = {
    1: "illegal value",
    2: "wrong token",
    3: "invalid bit",
    4: "queue full",
    5: "not compatible with its present state",
}
COMMAND_ERRORS = {
    1: "illegal command",
    2: "undefined command",
    3: "illegal query",
    4: "illegal set",
    5: "missing parameter",
    6: "extra parameter",
    7: "null parameter",
    8: "parameter buffer overflow",
    9: "bad floating-point number",
    10: "bad integer",
    11: "bad integer token",
    12: "bad token value",
    13: "bad hexadecimal block",
    14: "unknown token",
}

_log = logging.getLogger(__name__)


class DC205Options(Table):
    """Options: range of the output, and baud rate."""

    range_V: Literal[1, 10, 100] = 10
    """Range of the output, in V, in both directions."""
    baud: Literal[9600, 115200] = 115200
    """Baud rate of the serial line."""


class DC205:
    """DC205 source. Its output stays off until the first write, unless it was on already."""

    def __init__(
        self, options: DC205Options, connect: Callable[[Callable[[Link], None]], Link]
    ) -> None:
        self._range_V = options.range_V
        self._on = False
        self._link = connect(self._prepare)
        try:
            self._prepare(self._link)
        except InstrumentError:
            self._link.close()
            raise

    def write_V(self, voltage_V: float) -> None:
        """Apply a voltage, rounded to 1 µV; returns when the source has accepted it.

        The first write switches the output on, after the voltage has been accepted.

        Raises
        ------
        InstrumentError
            If the voltage is not a number within the range, before anything is sent; if the source
            refuses it or does not answer; if the output was switched off at the instrument, in
            which case it must be opened again.
        """
        if not isfinite(voltage_V) or abs(voltage_V) > self._range_V:
            text = f"DC205: {voltage_V} V refused, limit ±{float(self._range_V)} V"
            raise InstrumentError(text, "misused")
        what = f"{voltage_V:+.6f} V"
        if not self._on:
            self._set(SETTING % voltage_V, what)
            self._set(b"SOUT 1", what)
            self._on = True
            return
        switch, *errors = self._ask(SETTING % voltage_V + b";SOUT?;LEXE?;LCME?", 3)
        _check(what, errors)
        if not _token(switch, SWITCH):
            text = (
                f"DC205: {what} not put out: the output has been switched off at the "
                "instrument; find out why, then restart the program"
            )
            raise InstrumentError(text, "refused")

    def read_V(self) -> float:
        """Return the output voltage of the source in V; 0.0 while its output is off.

        Raises
        ------
        InstrumentError
            If the source is overloaded, does not answer, or not with a voltage.
        """
        voltage, switch, load = self._ask(b"VOLT?;SOUT?;OVLD?", 3)
        voltage_V = _voltage_V(voltage)
        if _token(load, LOAD):
            text = f"DC205: overloaded, {voltage_V:+.6f} V is not held; check the load"
            raise InstrumentError(text, "invalid")
        return voltage_V if _token(switch, SWITCH) else 0.0

    def close(self) -> None:
        """Close the port; the output keeps its voltage."""
        self._link.close()

    def _set(self, settings: bytes, what: str) -> None:
        """Send settings and ask whether they were accepted; raises InstrumentError."""
        _check(what, self._ask(settings + b";LEXE?;LCME?", 2))

    def _ask(self, line: bytes, count: int) -> list[bytes]:
        """Exchange one line, whose queries have ``count`` answers; raises InstrumentError."""
        reply = self._link.exchange(line)
        words = [word.strip() for word in reply.split(b";")]
        if len(words) != count:
            text = f"DC205: {reply[:40]!r} is {len(words)} answers to {line!r}, must be {count}"
            raise InstrumentError(text, "garbled")
        return words

    def _prepare(self, _link: Link) -> None:
        """Read name and state, clear earlier errors, set the range; moves nothing.

        An output that was on and is now off, for example after a power loss, is not switched on
        again; each later write raises an error.
        """
        (name,) = self._ask(b"TERM LF;*IDN?", 1)
        if b",DC205," not in name:
            raise InstrumentError(f"DC205: {name[:40]!r} names another instrument", "garbled")
        # The first two answers are earlier errors; reading clears them.
        _, _, found, switch, voltage = self._ask(b"LEXE?;LCME?;RNGE?;SOUT?;VOLT?", 5)
        found_V = tuple(RANGES)[_token(found, tuple(RANGES.values()))]
        voltage_V, on = _voltage_V(voltage), _token(switch, SWITCH) == 1
        if found_V != self._range_V and on:
            text = (
                f"DC205: its output is on, {voltage_V:+.6f} V in the range of ±{found_V} V; switch "
                f"it off, so that the range of ±{self._range_V} V can be set"
            )
            raise InstrumentError(text, "refused")
        if found_V != self._range_V:
            range_ = RANGES[self._range_V]
            self._set(b"VOLT 0;RNGE " + range_, f"range of ±{self._range_V} V")
        self._on = self._on or on


def answers(request: bytes) -> re.Pattern[bytes]:
    """Return the pattern of the answers to a line: one word for each of its queries."""
    return _answers_to(tuple(QUERY.findall(request)))


@cache
def _answers_to(queries: tuple[bytes, ...]) -> re.Pattern[bytes]:
    words = [ANSWERS.get(name, TOKEN) for name in queries]
    return re.compile(rb"\s*;\s*".join(b"(" + word + b")" for word in words) + rb"\s*")


def _check(what: str, errors: list[bytes]) -> None:
    """Raise an error unless both numbers are 0: last execution error and last command error."""
    for kind, word, meanings in zip(
        ("execution", "command"), errors, (EXECUTION_ERRORS, COMMAND_ERRORS), strict=True
    ):
        if CODE.fullmatch(word) is None:
            text = f"DC205: {what} answered by {word[:40]!r}, not an error code"
            raise InstrumentError(text, "garbled")
        if code := int(word):
            meaning = meanings.get(code, "no meaning known")
            text = f"DC205: {what} refused, {kind} error {code} ({meaning})"
            raise InstrumentError(text, "refused")


def _token(word: bytes, tokens: tuple[bytes, ...]) -> int:
    """Return the number of a token, which the source sends as a name or as a number."""
    for number, token in enumerate(tokens):
        if word in (token, b"%d" % number):
            return number
    text = f"DC205: {word[:40]!r} is none of {', '.join(map(repr, tokens))}"
    raise InstrumentError(text, "garbled")


def _voltage_V(word: bytes) -> float:
    if VALUE.fullmatch(word) is None:
        raise InstrumentError(f"DC205: {word[:40]!r} has no voltage", "garbled")
    return float(word)


def timing(settings: Output) -> Timing:
    """Return the time of the longest write with its answer, at ten bits a byte.

    Raises
    ------
    ConfigError
        If an option is unknown or impossible.
    """
    options = read_options(DC205Options, "srs_dc205", settings.options)
    request = SETTING % -float(options.range_V) + b";SOUT?;LEXE?;LCME?"
    note = "the source's response is not known; 0 ms is assumed"
    return Timing(exchange_s(len(request) + len(b"ON;0;0") + 2, options.baud), note=note)


def open_output(settings: Output, link: Link | None = None) -> DC205:
    """Open the port, or use ``link``, and check that the source answers; moves nothing.

    If the output is off, the range is set, which also sets the voltage to 0 V. An output that is on
    is left unchanged.

    Raises
    ------
    ConfigError
        If an option is unknown or impossible.
    InstrumentError
        If the port cannot be opened, the source does not answer as it should, or its output is
        on in another range.
    """
    options = read_options(DC205Options, "srs_dc205", settings.options)

    def connect(on_open: Callable[[Link], None]) -> Link:
        if link is not None:
            return link
        if not MET:
            _log.warning(
                "srs_dc205 has not been tested with its instrument: it is written from the manual"
            )
        return open_link(
            settings.url,
            baud=options.baud,
            timeout_s=settings.timeout_s,
            terminator=b"\n",
            answers=answers,
            probes=PROBES,
            on_open=on_open,
            record=settings.record,
        )

    return DC205(options, connect)
