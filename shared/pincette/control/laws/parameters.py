"""Gains of a law as data: names, meanings, and the values that a job chooses.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from dataclasses import dataclass

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.quantities import Items, Number, Text
from pincette.control.record import FrozenRecord
from pincette.control.vocabulary import ForceAge, ParameterSet


@dataclass(frozen=True, slots=True)
class LawParameter:
    """A gain of a law: a finite number ≥ 0."""

    name: str
    unit: str
    meaning: str
    default: float
    positive: bool = False
    """True if 0 is refused."""
    printed: float | None = None
    """Value in the paper, used with the printed set; None: the default."""
    identified: float | None = None
    """Value with the identified set, whose law includes hysteresis and creep; None: the default."""

    def value(self, parameter_set: ParameterSet) -> float:
        """Return the default value of the gain in a parameter set."""
        of_set = {"printed": self.printed, "identified": self.identified}.get(parameter_set)
        return self.default if of_set is None else of_set

    def check(self, value: float) -> float:
        """Return ``value``; raise ValueError if the law does not accept it."""
        require = require_positive if self.positive else require_not_negative
        return require(self.name, value, self.unit)


class Gain(FrozenRecord, frozen=True):
    """Name and value of a gain; its unit is that of the law's parameter."""

    name: Text
    value: Number


class LawSpec(FrozenRecord, frozen=True):
    """A law as named in a motion program; the controller looks up the scheme and builds the law."""

    scheme: Text
    """Name under which the law is registered."""
    set: ParameterSet = "consistent"
    """Parameter set of the law: m, b, k, d of the rig (consistent) or of the paper (printed), or
    those of the rig with the identified free response instead of the line d·u (identified)."""
    force_age: ForceAge = "planned"
    """Estimate used as F_k: the newest one unchanged, or extrapolated to k by the planned change of
    F_r."""
    gains: Items[Gain] = ()
    """Gains; the defaults of the law are used for those not given."""
