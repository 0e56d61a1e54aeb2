"""Faults of a simulated instrument and its line, on the rig's clock; pure except for the reading.

The active faults depend only on the time and the orders. Random values depend only on the seed, the
target and the number of the exchange. Therefore a run in lockstep is reproducible bit by bit.
"""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import blake2b
from math import copysign, inf

from pincette.core.messages import SimCommand

OVER_RANGE_UM = 1e12
"""Position in µm that is beyond the range of any instrument."""
LONGEST_GARBAGE = 24
ENDS = b"\r\n"
EDGE_S = 1e-9
"""Tolerance for equal times, in s; times of ticks are products and sums of floats."""


class HungUpError(ConnectionResetError):
    """The simulated port is unplugged; its server hangs up."""


@dataclass(frozen=True, slots=True)
class Fault:
    """An order that lasts from ``begin_s`` until just before ``end_s``."""

    target: str
    what: str
    value: float
    begin_s: float
    end_s: float = inf


@dataclass(frozen=True, slots=True)
class Faults:
    """Active faults of one target at one time; of each kind only the newest has an effect."""

    held: tuple[Fault, ...] = ()

    def value(self, what: str) -> float | None:
        """Return the value of the newest fault of a kind; None if none is active."""
        return next((fault.value for fault in reversed(self.held) if fault.what == what), None)

    def __bool__(self) -> bool:
        return bool(self.held)


def fault_of(order: SimCommand, now_s: float, default: float) -> Fault:
    """Return an order as a fault on the rig's clock."""
    begin_s = now_s + order.after_s
    end_s = inf if order.for_s is None else begin_s + order.for_s
    value = default if order.value is None else order.value
    return Fault(order.target, order.what, value, begin_s, end_s)


def holding(faults: Iterable[Fault], target: str, now_s: float) -> Faults:
    """Return active faults of a target; a ``heal`` ends the earlier ones, ties keep their order."""
    held: list[Fault] = []
    for fault in sorted(faults, key=lambda fault: fault.begin_s):
        if fault.target != target or fault.begin_s > now_s + EDGE_S:
            continue
        if fault.what == "heal":
            held.clear()
        elif now_s + EDGE_S < fault.end_s:
            held.append(fault)
    return Faults(tuple(held))


def left(faults: Iterable[Fault], now_s: float) -> list[Fault]:
    """Return the active and the future faults."""
    known = list(faults)
    held = [
        fault
        for target in dict.fromkeys(fault.target for fault in known)
        for fault in holding(known, target, now_s).held
    ]
    return held + [fault for fault in known if fault.begin_s > now_s + EDGE_S]


def chance(key: str, number: int) -> bytes:
    """Return 64 random bytes that depend only on the arguments."""
    return blake2b(f"{key}/{number}".encode()).digest()


def lost(share: float, drawn: bytes) -> bool:
    """Return whether an exchange belongs to the fraction that is lost."""
    return int.from_bytes(drawn[:8]) < share * 2.0**64


def garbage(drawn: bytes) -> bytes:
    """Return some random bytes, none of which ends a line."""
    length = 1 + drawn[0] % LONGEST_GARBAGE
    return bytes(byte for byte in drawn[1 : 1 + length] if byte not in ENDS)


class Past:
    """Values with their times over a limited duration, and one value for all earlier times."""

    def __init__(self, kept_s: float, first: float = 0.0) -> None:
        self._kept_s = kept_s
        self._known: list[tuple[float, float]] = [(-inf, first)]

    def note(self, now_s: float, value: float) -> None:
        """Add the newest value."""
        self._known.append((now_s, value))
        old_s = now_s - self._kept_s
        # Keep the newest value that is too old: it was still valid at the beginning of the
        # duration.
        while self._known[1][0] <= old_s:
            del self._known[0]

    def at(self, time_s: float) -> float:
        """Return the value valid at a time: the newest one that is not after it."""
        place = bisect_right(self._known, time_s + EDGE_S, key=lambda known: known[0])
        return self._known[max(0, place - 1)][1]

    @property
    def newest(self) -> float:
        """Return the last added value."""
        return self._known[-1][1]


def misread_um(faults: Faults, past: Past, now_s: float) -> float:
    """Return the position that the sensor reports.

    ``past`` contains the true readings up to the time at which the sensor got stuck, if it is
    stuck.
    """
    delay_s = faults.value("delayed")
    x_um = past.newest if delay_s is None else past.at(now_s - delay_s)
    x_um += faults.value("wrong") or 0.0
    side = faults.value("over_range")
    return x_um if side is None else copysign(OVER_RANGE_UM, side)


def misput_V(faults: Faults, past: Past, now_s: float) -> float:
    """Return the voltage that the output applies.

    ``past`` contains the requested voltages up to the time at which the output got stuck, if it is
    stuck.
    """
    delay_s = faults.value("delayed")
    asked_V = past.newest if delay_s is None else past.at(now_s - delay_s)
    return asked_V + (faults.value("wrong") or 0.0)
