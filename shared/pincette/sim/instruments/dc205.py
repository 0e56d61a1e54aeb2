"""Stanford Research Systems DC205 as seen from its serial line: settings, queries, error codes.

It knows TERM, TOKN, *IDN?, RNGE, SOUT, VOLT, OVLD?, LEXE? and LCME?; other commands cause command
error 2. The command errors and the line's length are those of the manual, chapter 3, the execution
errors those of public drivers. Assumptions without a source: a range change while the output is on
is execution error 5; a wrong command does not stop the rest of its line; commands are upper case;
the voltage is resolved to 1 µV in each range; the terminals are at 0 V while the output is off; a
voltage beyond a smaller range becomes 0 V when that range is set. The instrument starts in the
state after *RST (±1 V, 0 V, off), and replies with names for tokens. Not simulated: TERM other than
LF, interlock, settling, the update limit, status registers, scanning.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite

TERMINATOR = b"\n"
LONGEST_LINE = 128
IDENTITY = b"Stanford Research Systems,DC205,s/n20500000,ver1.00"
HEADER = re.compile(rb"(\*?[A-Z]{3,4})(\?)?(?:\s+(.*))?")
NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([Ee][+-]?\d+)?")
TOKENS: dict[bytes, tuple[bytes, ...]] = {
    b"TERM": (b"NONE", b"CR", b"LF", b"CRLF", b"LFCR"),
    b"TOKN": (b"OFF", b"ON"),
    b"RNGE": (b"RANGE1", b"RANGE10", b"RANGE100"),
    b"SOUT": (b"OFF", b"ON"),
    b"OVLD": (b"OKAY", b"OVLD"),
}
RANGES_V = (1.0, 10.0, 100.0)
LINE_FEED = 2
QUERIES_ALONE = (b"*IDN", b"OVLD", b"LEXE", b"LCME")
DECIMALS = 6

ILLEGAL_VALUE, NOT_COMPATIBLE = 1, 5
ILLEGAL, UNDEFINED, ILLEGAL_QUERY, ILLEGAL_SET = 1, 2, 3, 4
MISSING, EXTRA, NULL, BAD_FLOAT, BAD_TOKEN_VALUE, UNKNOWN_TOKEN = 5, 6, 7, 9, 12, 14


class _CommandError(Exception):
    """Error of a command that cannot be parsed; carries the code that LCME? will return."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


@dataclass(slots=True)
class SimulatedDC205:
    """Source that calls ``put_out`` for each voltage while it is on, and when it is switched."""

    put_out: Callable[[float], None]
    overloaded: bool = False
    _voltage_V: float = field(default=0.0, init=False)
    _states: dict[bytes, int] = field(
        default_factory=lambda: {b"TERM": LINE_FEED, b"TOKN": 1, b"RNGE": 0, b"SOUT": 0},
        init=False,
    )
    _errors: dict[bytes, int] = field(default_factory=lambda: {b"LEXE": 0, b"LCME": 0}, init=False)

    def power_cycle(self) -> None:
        """Simulate an interruption of the supply: state as after *RST, with the output off."""
        self._states |= {b"RNGE": 0, b"SOUT": 0}
        self._voltage_V = 0.0
        self._errors = dict.fromkeys(self._errors, 0)
        self.put_out(0.0)

    def idle(self) -> None:
        """Do nothing: this instrument acts only on commands."""

    def answer(self, line: bytes) -> bytes | None:
        """Execute one line of commands; returns None if none of them is a query."""
        if len(line) > LONGEST_LINE:
            return None
        replies: list[bytes] = []
        for part in line.split(b";"):
            command = part.strip()
            if not command:
                continue
            try:
                reply = self._carry_out(command)
            except _CommandError as error:
                self._errors[b"LCME"] = error.code
                continue
            if reply is not None:
                replies.append(reply)
        return b";".join(replies) if replies else None

    def _carry_out(self, command: bytes) -> bytes | None:
        match = HEADER.fullmatch(command)
        if match is None:
            raise _CommandError(ILLEGAL)
        name, query, parameter = match[1], match[2], match[3]
        if name not in TOKENS and name not in QUERIES_ALONE and name != b"VOLT":
            raise _CommandError(UNDEFINED)
        if query:
            if parameter is not None:
                raise _CommandError(EXTRA)
            return self._shown(name)
        if name in QUERIES_ALONE:
            raise _CommandError(ILLEGAL_SET)
        if parameter is None:
            raise _CommandError(MISSING)
        first, comma, _ = parameter.partition(b",")
        if not first:
            raise _CommandError(NULL)
        if comma:
            raise _CommandError(EXTRA)
        if name == b"VOLT":
            self._set_voltage(first)
        else:
            self._set_token(name, _token(name, first))
        return None

    def _shown(self, name: bytes) -> bytes:
        if name == b"*IDN":
            return IDENTITY
        if name == b"VOLT":
            return f"{self._voltage_V:.{DECIMALS}f}".encode()
        if name in self._errors:
            code, self._errors[name] = self._errors[name], 0
            return b"%d" % code
        number = int(self.overloaded) if name == b"OVLD" else self._states[name]
        return TOKENS[name][number] if self._states[b"TOKN"] else b"%d" % number

    def _set_voltage(self, text: bytes) -> None:
        if NUMBER.fullmatch(text) is None:
            raise _CommandError(BAD_FLOAT)
        voltage_V = float(text)
        if not isfinite(voltage_V) or abs(voltage_V) > RANGES_V[self._states[b"RNGE"]]:
            self._errors[b"LEXE"] = ILLEGAL_VALUE
            return
        self._voltage_V = round(voltage_V, DECIMALS)
        if self._states[b"SOUT"]:
            self.put_out(self._voltage_V)

    def _set_token(self, name: bytes, number: int) -> None:
        if name == b"RNGE" and self._states[b"SOUT"]:
            self._errors[b"LEXE"] = NOT_COMPATIBLE
            return
        if name == b"TERM" and number != LINE_FEED:
            self._errors[b"LEXE"] = NOT_COMPATIBLE
            return
        changed, self._states[name] = self._states[name] != number, number
        if name == b"RNGE" and abs(self._voltage_V) > RANGES_V[number]:
            self._voltage_V = 0.0
        if name == b"SOUT" and changed:
            self.put_out(self._voltage_V if number else 0.0)


def _token(name: bytes, text: bytes) -> int:
    """Return the number of a token, which may be given by name or by number."""
    tokens = TOKENS[name]
    if text in tokens:
        return tokens.index(text)
    if not text.isdigit():
        raise _CommandError(UNKNOWN_TOKEN)
    if len(text) > 1 or int(text) >= len(tokens):
        raise _CommandError(BAD_TOKEN_VALUE)
    return int(text)
