"""Commands of the Keyence controllers: fields, error codes, and the form of a value.

Assumed: the error codes of the LK-G5000, of which only the numbers are known, have the meanings of
those of the LK-G3000, in the same order; a line longer than any command has the error of a wrong
length; outputs are numbered from 1, with two digits in readings and one or two in settings.
"""

from dataclasses import dataclass
from math import isfinite
from typing import Literal

Unit = Literal["um", "mm"]
Dialect = Literal["LK-G5000", "LK-G3000"]
Fault = Literal["unknown", "mode", "length", "count", "parameter", "timeout", "other"]

DECIMALS: dict[str, int] = {"um": 2, "mm": 5}
UM_PER_UNIT: dict[str, float] = {"um": 1.0, "mm": 1000.0}
WIDTH = 7
INVALID = b"XXXXXXXX"
LONGEST_COMMAND = 32
SAMPLING_S = (2.55e-6, 5e-6, 10e-6, 20e-6, 50e-6, 100e-6, 200e-6, 500e-6, 1000e-6)
MOST_FOURS = 9
"""Largest exponent i for an average over 4^i samples; assumed."""

FAULTS: tuple[Fault, ...] = ("unknown", "mode", "length", "count", "parameter", "timeout", "other")
CODES: dict[Dialect, dict[Fault, bytes]] = {
    "LK-G5000": dict(zip(FAULTS, (b"50", b"51", b"60", b"61", b"62", b"88", b"99"), strict=True)),
    "LK-G3000": dict(zip(FAULTS, (b"00", b"01", b"20", b"21", b"22", b"88", b"99"), strict=True)),
}
SAME_MODE = b"01"
"""Answer of both controllers to R0 or Q0 in the requested mode."""


@dataclass(frozen=True, slots=True)
class Command:
    """Smallest and largest number of fields of a command, and the mode that it needs; None: any."""

    least: int
    most: int
    measuring: bool | None


_COMMON = {
    b"R0": Command(0, 0, None),
    b"Q0": Command(0, 0, None),
    b"VR": Command(1, 1, measuring=True),
    b"KL": Command(1, 1, measuring=True),
    b"SW": Command(2, 4, measuring=False),
}
COMMANDS: dict[Dialect, dict[bytes, Command]] = {
    "LK-G5000": _COMMON
    | {
        b"MS": Command(1, 1, measuring=True),
        b"MM": Command(1, 1, measuring=True),
        b"MA": Command(0, 0, measuring=True),
    },
    "LK-G3000": _COMMON | {name: Command(0, 0, measuring=True) for name in (b"M0", b"M1", b"M2")},
}
OUTPUTS: dict[Dialect, int] = {"LK-G5000": 12, "LK-G3000": 2}


class Refused(Exception):
    """A command whose answer is an error."""

    def __init__(self, fault: Fault) -> None:
        super().__init__(fault)
        self.fault: Fault = fault


def value(position_um: float | None, unit: Unit) -> bytes:
    """Return a value as a sign and seven characters, zero padded, with the decimal point.

    ``None`` means an invalid reading.
    """
    if position_um is None or not isfinite(position_um):
        return INVALID
    decimals = DECIMALS[unit]
    count = round(position_um / UM_PER_UNIT[unit] * 10**decimals)
    sign = "-" if count < 0 else "+"
    whole, part = divmod(abs(count), 10**decimals)
    text = f"{whole:0{WIDTH - 1 - decimals}d}.{part:0{decimals}d}"
    return (sign + (text if len(text) == WIDTH else "FFFFFFF")).encode()


def number(field: bytes, least: int, most: int) -> int:
    """Return the number in a field of one or two digits; raises Refused."""
    if not field.isdigit() or len(field) > 2 or not least <= int(field) <= most:
        raise Refused("parameter")
    return int(field)


def chosen(command: bytes, fields: list[bytes], dialect: Dialect) -> list[int]:
    """Return the outputs that a measuring command reads; raises Refused."""
    every = list(range(1, OUTPUTS[dialect] + 1))
    if command in (b"MA", b"M0"):
        return every
    if command in (b"M1", b"M2"):
        return [int(command[1:])]
    (field,) = fields
    if command == b"MS":
        if len(field) != 2:
            raise Refused("parameter")
        return [number(field, 1, len(every))]
    wanted = [output for output in every if field[output - 1 : output] == b"1"]
    if len(field) != len(every) or len(wanted) + field.count(b"0") != len(every) or not wanted:
        raise Refused("parameter")
    return wanted
