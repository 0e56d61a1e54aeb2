"""Stanford Research Systems DC205 voltage source: ±1, ±10 or ±100 V, over USB or RS-232.

From chapter 3 of its operation and service manual (revision 0.30): 8N1, lines end with LF after
``TERM LF``, commands of one line are parted by ``;`` and so are the answers to its queries.
``VOLT 1.234567`` sets the voltage, ``SOUT 1`` switches the output on, ``RNGE RANGE10`` sets the
range, only while the output is off. Settings have no reply: ``LEXE?;LCME?`` answers ``0;0``, the
last execution and command error, cleared by reading. USB is fixed at 115200 baud; RS-232 starts at
9600, at which a write lasts 40 ms and misses T = 20 ms.

From public drivers, not seen in the manual: the execution errors' meanings, and that ``VOLT?`` is
the setting, not a measurement. Unverified: how fast the output may be updated and settles, the
resolution within a range, whether an overload is latched, what the terminals do while the output
is off (0 V is assumed). The ±100 V range needs the instrument's interlock closed.

No watchdog on the host is known of it: where the program or the host dies, the last voltage stays.
"""

import logging
import re
from dataclasses import dataclass
from math import isfinite
from typing import Literal

from pincette.config import Output, Table
from pincette.instruments.link import open_link
from pincette.instruments.options import read_options
from pincette.instruments.protocols import InstrumentError, Link

MET = False
"""Whether this driver has met its instrument."""
VALUE = re.compile(rb"[+-]?\d{1,3}(\.\d{1,9})?(E[+-]?\d{1,2})?")
CODE = re.compile(rb"\d{1,3}")
RANGES = {1: b"RANGE1", 10: b"RANGE10", 100: b"RANGE100"}
SWITCH = (b"OFF", b"ON")
LOAD = (b"OKAY", b"OVLD")
"""Tokens in the order of their numbers: the instrument says either, as TOKN is set."""
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
    """Range of the output, and the line's speed."""

    range_V: Literal[1, 10, 100] = 10
    baud: Literal[9600, 115200] = 115200


@dataclass(slots=True)
class DC205:
    """The source; ``on`` is whether its output has been found or switched on."""

    link: Link
    limit_V: float
    on: bool

    def write_V(self, voltage_V: float) -> None:
        """Put out a voltage, rounded to 1 µV; returns when the source has accepted it.

        The first write switches the output on, after the voltage has been accepted.

        Raises
        ------
        InstrumentError
            Where the voltage is not a number within the range, before anything is sent; where the
            source refuses it or does not answer; where somebody has switched the output off, which
            only opening it again undoes.
        """
        if not isfinite(voltage_V) or abs(voltage_V) > self.limit_V:
            raise InstrumentError(f"DC205: {voltage_V} V refused, limit ±{self.limit_V} V")
        setting = b"VOLT %.6f" % voltage_V
        what = f"{voltage_V:+.6f} V"
        if not self.on:
            self.set(setting, what)
            self.set(b"SOUT 1", what)
            self.on = True
            return
        switch, *errors = self.ask(setting + b";SOUT?;LEXE?;LCME?", 3)
        _check(what, errors)
        if not _token(switch, SWITCH):
            raise InstrumentError(
                f"DC205: {what} not put out: the output has been switched off at the instrument; "
                "see why, then open it again"
            )

    def read_V(self) -> float:
        """Return the voltage that the source holds at its output; 0.0 while it is off.

        Raises
        ------
        InstrumentError
            Where the source is overloaded, does not answer, or not with a voltage.
        """
        voltage, switch, load = self.ask(b"VOLT?;SOUT?;OVLD?", 3)
        voltage_V = _voltage_V(voltage)
        if _token(load, LOAD):
            raise InstrumentError(
                f"DC205: overloaded, {voltage_V:+.6f} V is not held; check the load"
            )
        return voltage_V if _token(switch, SWITCH) else 0.0

    def close(self) -> None:
        """Give the port back; the output stays as it is."""
        self.link.close()

    def set(self, settings: bytes, what: str) -> None:
        """Send settings and ask whether they were accepted; raises InstrumentError."""
        _check(what, self.ask(settings + b";LEXE?;LCME?", 2))

    def ask(self, line: bytes, count: int) -> list[bytes]:
        """Exchange one line, whose queries have ``count`` answers; raises InstrumentError."""
        reply = self.link.exchange(line)
        words = [word.strip() for word in reply.split(b";")]
        if len(words) != count:
            raise InstrumentError(
                f"DC205: {reply[:40]!r} is {len(words)} answers to {line!r}, {count} wanted"
            )
        return words


def _check(what: str, errors: list[bytes]) -> None:
    """Refuse any pair but 0 and 0: the last execution error, the last command error."""
    for kind, word, meanings in zip(
        ("execution", "command"), errors, (EXECUTION_ERRORS, COMMAND_ERRORS), strict=True
    ):
        if CODE.fullmatch(word) is None:
            raise InstrumentError(f"DC205: {what} answered by {word[:40]!r}, no error code")
        if code := int(word):
            meaning = meanings.get(code, "no meaning known")
            raise InstrumentError(f"DC205: {what} refused, {kind} error {code} ({meaning})")


def _token(word: bytes, tokens: tuple[bytes, ...]) -> int:
    """Return the number of a token, which is sent as its name or as its number."""
    for number, token in enumerate(tokens):
        if word in (token, b"%d" % number):
            return number
    raise InstrumentError(f"DC205: {word[:40]!r} is none of {', '.join(map(repr, tokens))}")


def _voltage_V(word: bytes) -> float:
    if VALUE.fullmatch(word) is None:
        raise InstrumentError(f"DC205: {word[:40]!r} carries no voltage")
    return float(word)


def open_output(settings: Output, link: Link | None = None) -> DC205:
    """Open the port, or take ``link``, and make sure that the source answers; moves nothing.

    While the output is off the range is set, and the voltage with it to 0 V. An output that is on
    is left as it is.

    Raises
    ------
    ConfigError
        Where an option is unknown or impossible.
    InstrumentError
        Where the port cannot be opened, the source does not answer as it should, or its output is
        on in another range.
    """
    options = read_options(DC205Options, "srs_dc205", settings.options)
    if link is None:
        if not MET:
            _log.warning("srs_dc205 has not met its instrument: it is written from the manual")
        link = open_link(
            settings.url, baud=options.baud, timeout_s=settings.timeout_s, terminator=b"\n"
        )
    try:
        return _prepared(link, options.range_V)
    except InstrumentError:
        link.close()
        raise


def _prepared(link: Link, range_V: int) -> DC205:
    """Ask for the name and the state, and set the range where that moves nothing."""
    output = DC205(link, float(range_V), on=False)
    (name,) = output.ask(b"TERM LF;*IDN?", 1)
    if b",DC205," not in name:
        raise InstrumentError(f"DC205: {name[:40]!r} names another instrument")
    # The first two answers are what went wrong before, and are cleared by this.
    _, _, found, switch, voltage = output.ask(b"LEXE?;LCME?;RNGE?;SOUT?;VOLT?", 5)
    ranges = tuple(RANGES.values())
    voltage_V, found_V = _voltage_V(voltage), tuple(RANGES)[_token(found, ranges)]
    output.on = _token(switch, SWITCH) == 1
    if found_V == range_V:
        return output
    if output.on:
        raise InstrumentError(
            f"DC205: its output is on, {voltage_V:+.6f} V in the range of ±{found_V} V; switch it "
            f"off, so that the range of ±{range_V} V can be set"
        )
    output.set(b"VOLT 0;RNGE " + RANGES[range_V], f"range of ±{range_V} V")
    return output
