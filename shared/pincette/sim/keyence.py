"""The Keyence LK-G5000 as its RS-232 line shows it: commands, modes, 8-character values.

Sampling (SW,CA), averaging (SW,OC), panel lock (KL) and reset (VR) are answered and have no
effect; unsolicited TG lines are not sent. Error codes are those of the LK-G3000 table, with which
the mode commands of the LK-G5000 answer too.
"""

from collections.abc import Callable
from math import isfinite
from typing import Literal

Unit = Literal["um", "mm"]
DECIMALS: dict[str, int] = {"um": 2, "mm": 5}
UM_PER_UNIT: dict[str, float] = {"um": 1.0, "mm": 1000.0}
WIDTH = 7
OUTPUTS = 12
INVALID = b"XXXXXXXX"

UNKNOWN, WRONG_MODE, LENGTH, COUNT, PARAMETER = b"00", b"01", b"20", b"21", b"22"
MEASURING = {b"MS", b"MM", b"MA", b"VR", b"KL"}
SETTING = {b"SW"}
FIELDS: dict[bytes, tuple[int, int]] = {
    b"MS": (1, 1),
    b"MM": (1, 1),
    b"MA": (0, 0),
    b"VR": (1, 1),
    b"KL": (1, 1),
    b"SW": (2, 4),
    b"R0": (0, 0),
    b"Q0": (0, 0),
}


def value(position_um: float | None, unit: Unit) -> bytes:
    """Eight characters: sign, then 7 with the point, zero padded; None is an invalid reading."""
    if position_um is None or not isfinite(position_um):
        return INVALID
    decimals = DECIMALS[unit]
    count = round(position_um / UM_PER_UNIT[unit] * 10**decimals)
    sign = "-" if count < 0 else "+"
    whole, part = divmod(abs(count), 10**decimals)
    text = f"{whole:0{WIDTH - 1 - decimals}d}.{part:0{decimals}d}"
    return (sign + (text if len(text) == WIDTH else "FFFFFFF")).encode()


class SimulatedKeyence:
    """A controller whose outputs all show ``measure()``, in µm; None is an invalid reading."""

    def __init__(self, measure: Callable[[], float | None], unit: Unit = "um") -> None:
        self._measure = measure
        self._unit: Unit = unit
        self._measuring = True

    def idle(self) -> None:
        """Do nothing: this instrument speaks only when asked."""

    def answer(self, line: bytes) -> bytes | None:
        """Answer one command line; commands are case-insensitive."""
        command, *fields = line.strip().upper().split(b",")
        if not command:
            return None
        code = self._refuse(command, fields)
        if code is not None:
            return b"ER," + command + b"," + code
        if command in (b"R0", b"Q0"):
            self._measuring = command == b"R0"
            return command
        if command == b"SW":
            return b"SW," + fields[0]
        if command in (b"VR", b"KL"):
            return command
        shown = self._shown(command, fields)
        return command + b"," + shown if shown else b"ER," + command + b"," + PARAMETER

    def _refuse(self, command: bytes, fields: list[bytes]) -> bytes | None:
        if command not in FIELDS:
            return UNKNOWN
        least, most = FIELDS[command]
        if not least <= len(fields) <= most:
            return COUNT
        wrong = (MEASURING | {b"Q0"}) if not self._measuring else (SETTING | {b"R0"})
        return WRONG_MODE if command in wrong else None

    def _shown(self, command: bytes, fields: list[bytes]) -> bytes:
        """Return the fields after the command's main part; empty where a parameter is wrong."""
        if command == b"MA":
            return b",".join([value(self._measure(), self._unit)] * OUTPUTS)
        (field,) = fields
        if command == b"MS":
            known = len(field) == 2 and field.isdigit() and 1 <= int(field) <= OUTPUTS
            return field + b"," + value(self._measure(), self._unit) if known else b""
        chosen = field.count(b"1")
        if len(field) != OUTPUTS or chosen + field.count(b"0") != OUTPUTS or not chosen:
            return b""
        return b",".join([field] + [value(self._measure(), self._unit)] * chosen)
