"""H transcribed on its own, in plain floats, and what (17) with k·H(u) in place of d·u asks for.

Plays by their definition, z = u - y within ±r, with dz/du = 1 - λ·z·sign(du) in closed form; creep
τ·ċ = y - c in closed form over a period. The voltage is found by halving, not by a secant.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp
from pathlib import Path

from tests.unit.control.laws.transcription import (
    PAST,
    TICKS,
    Case,
    Row,
    signals,
    transcribe,
)

GOLDEN = Path(__file__).parent / "golden" / "identified.json"
GOLDEN_TICKS = (0, 1, 60, 219)
PERIOD_S, D_P = 0.02, 19.0
THRESHOLDS_V, FADINGS = (0.0, 0.1, 0.3, 0.5), (0.0, 0.0, 2.0, 1.0)
WEIGHTS = (14.0, 2.0, 2.0, 1.5)
TIMES_S, SHARES = (0.1, 2.0), (0.02, 0.03)
CURVATURE = 0.2
CASES = [
    Case("pbsmic", "consistent", PERIOD_S, 1.0, 1.0, 0.0, 100.0),
    Case("pbsmic", "consistent", PERIOD_S, 0.5, 1.0, 0.5, 2.0),
    Case("dsmifc", "consistent", PERIOD_S, 1.0, 1.0, 0.0, 1e6),
    Case("dsmifc", "consistent", PERIOD_S, 0.5, 1.0, 0.5, 4e4),
]


@dataclass
class Actuator:
    """H and its memory: the plays' z = u - y, and the creep."""

    u: float = 0.0
    z: list[float] = field(default_factory=lambda: [0.0] * len(THRESHOLDS_V))
    c: list[float] = field(default_factory=lambda: [0.0] * len(TIMES_S))

    def after(self, u: float) -> "Actuator":
        """Return the state after a period at u."""
        way, side = abs(u - self.u), 1.0 if u > self.u else -1.0
        z: list[float] = []
        for r, fading, before in zip(THRESHOLDS_V, FADINGS, self.z, strict=True):
            if fading:
                kept = exp(-fading * way)
                free = before * kept + side * (1.0 - kept) / fading
            else:
                free = before + (u - self.u)
            z.append(max(-r, min(r, free)))
        y = self.static(u, z)
        c = [y + (c - y) * exp(-PERIOD_S / t) for c, t in zip(self.c, TIMES_S, strict=True)]
        return Actuator(u, z, c)

    @staticmethod
    def static(u: float, z: Sequence[float]) -> float:
        return CURVATURE * u * u + sum(w * (u - z) for w, z in zip(WEIGHTS, z, strict=True))

    @property
    def displacement(self) -> float:
        creep = sum(share * c for share, c in zip(SHARES, self.c, strict=True))
        return self.static(self.u, self.z) + creep

    def voltage_for(self, wanted: float) -> float:
        """Find the voltage by bisection."""
        low, high = self.u - 20.0, self.u + 20.0
        for _ in range(80):
            middle = 0.5 * (low + high)
            if self.after(middle).displacement < wanted:
                low = middle
            else:
                high = middle
        return 0.5 * (low + high)


def actuators() -> list[Actuator]:
    """Return the states after each sample of the applied voltages."""
    found = [Actuator()]
    for u in signals()["u"]:
        found.append(found[-1].after(u))
    return found[1:]


def transcribed(case: Case) -> list[tuple[float, Row]]:
    """Return u_k, and the row of the law in v = H/d_p, tick by tick."""
    led = actuators()
    given = signals()
    given["u"] = [actuator.displacement / D_P for actuator in led]
    rows = transcribe(case, given)
    return [
        (led[PAST + tick - 1].voltage_for(D_P * float(rows[tick]["voltage_V"][0])), rows[tick])
        for tick in range(TICKS)
    ]


def golden() -> dict[str, dict[str, float]]:
    """Return the stored voltages of a few ticks."""
    return {
        str(case): {str(tick): transcribed(case)[tick][0] for tick in GOLDEN_TICKS}
        for case in CASES
    }


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps(golden(), indent=1) + "\n", encoding="utf-8")
