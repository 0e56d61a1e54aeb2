"""Faults as codes and numbers. Programs compare codes; ``core.wording`` has texts for people."""

from math import isfinite

from pincette.control.quantities import MAX_TEXT, Items, Number, Text
from pincette.control.record import FrozenRecord
from pincette.control.vocabulary import LARGEST, FaultCode

ZERO_REFUSED = frozenset(code for code in FaultCode if code.name.startswith("ZERO_"))
"""Codes of the reasons for which the force is not zeroed."""
INSTRUMENT = frozenset(code for code in FaultCode if code.name.startswith("INSTRUMENT_"))
"""Codes that a driver reports about its instrument."""


class Value(FrozenRecord, frozen=True):
    """A named number whose name ends with its unit; None if it is not finite."""

    name: Text
    value: Number | None


class Fault(FrozenRecord, frozen=True):
    """A fault: a code and its numbers, and words only if they come from outside."""

    code: FaultCode
    values: Items[Value] = ()
    words: Text = ""
    """Words of a driver or a person. Programs do not evaluate them."""

    def number(self, name: str) -> float | None:
        """Return the value with this name; None if it is not finite or does not exist."""
        return next((item.value for item in self.values if item.name == name), None)

    def with_values(self, **values: float) -> "Fault":
        """Return this fault with further numbers."""
        return Fault(self.code, self.values + _values(values), self.words)


def fault(code: FaultCode, words: str = "", /, **values: float) -> Fault:
    """Return a fault with named numbers; numbers beyond 1e15 become 1e15."""
    return Fault(code, _values(values), words[:MAX_TEXT])


def _values(values: dict[str, float]) -> tuple[Value, ...]:
    return tuple(Value(name, _carried(value)) for name, value in values.items())


def _carried(value: float) -> float | None:
    most = LARGEST[""]
    return min(max(float(value), -most), most) if isfinite(value) else None
