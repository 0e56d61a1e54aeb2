"""Law of two arms as registered under ``pincette.laws``: its name and its gains."""

from dataclasses import dataclass

from pincette.control.arm.plant import ArmParameters
from pincette.control.laws.parameters import Gain, LawParameter, LawSpec
from pincette.control.laws.two_arms import PARAMETERS, default_gains


@dataclass(frozen=True, slots=True)
class TwoArmLaw:
    """The only law of rigs with ``[second]``; its step is ``two_arms.step``."""

    name: str
    title: str
    summary: str
    parameters: tuple[LawParameter, ...]
    arms: int = 2
    search: tuple[tuple[str, tuple[float, ...]], ...] = ()
    """Empty: no gains of this law are searched."""

    def gains(
        self, spec: LawSpec, arms: tuple[ArmParameters, ArmParameters], period_s: float
    ) -> dict[str, float]:
        """Return all gains of a motion program's law; raises ValueError for an unknown gain."""
        if spec.scheme != self.name:
            raise ValueError(f"law {spec.scheme!r} drives one arm, this rig has two: {self.name}")
        first, _ = arms
        values = default_gains((first.k / first.m) ** 0.5, period_s)
        for gain in spec.gains:
            if gain.name not in values:
                there = ", ".join(values)
                raise ValueError(f"{self.title} has no gain {gain.name}; its gains are {there}")
            values[gain.name] = gain.value
        for parameter in self.parameters:
            parameter.check(values[parameter.name])
        return values

    def spec(self, gains: dict[str, float]) -> LawSpec:
        """Return the law in the form used in a motion program."""
        named = tuple(Gain(name, value) for name, value in gains.items())
        return LawSpec(self.name, gains=named)


LAW = TwoArmLaw(
    "two_arms",
    "two arms",
    "place of the part and force on it, controlled independently by two driven arms",
    PARAMETERS,
)
