"""The law of two arms, transcribed: each filter as one difference equation of order n.

The law keeps stages of one pole; here F(z) = [(1-p)/(1-p·z⁻¹)]ⁿ is multiplied out,

    y_k = (1-p)ⁿ·w_k - Σ_j (-1)^j·C(n, j)·p^j·y_{k-j},   j = 1…n

and everything else is written from arm to arm, with no sum and difference of the free responses:

    X_1 = q_r + S/2·F_r + (s_1 - s_2)/2·F_r + l_1 - Ŵ_q - Ŵ_b/2,
    X_2 = -q_r + S/2·F_r - (s_1 - s_2)/2·F_r - l_2 + Ŵ_q - Ŵ_b/2
"""

import json
from math import comb, cos, exp, pi, sin
from pathlib import Path
from typing import NamedTuple

GOLDEN = Path(__file__).parent / "golden" / "two_arms.json"
GOLDEN_TICKS = (0, 1, 59, 60, 61, 180, 239, 240, 299)
TICKS = 300
OMEGAS, ZETAS, S = (2437.8, 2320.0), (0.026, 0.03), (0.46, 0.49)
C = 0.025
TOUCHED, LOST = 60, 240


class Case(NamedTuple):
    period_s: float
    n: int
    f_q: float
    f_F: float
    delay_s: float
    lag_s: float


CASES = [
    Case(0.001, 3, 60.0, 10.0, 0.00065, 0.0),
    Case(0.001, 4, 90.0, 20.0, 0.001, 0.0008),
    Case(0.0005, 2, 60.0, 15.0, 0.0002, 0.0),
    Case(0.02, 1, 5.5, 3.0, 0.005, 0.0033),
]


class Sample(NamedTuple):
    """Inputs of a tick for both arms, and q_r, F_r, d_r with their rates."""

    x: tuple[float, float]
    H: tuple[float, float]
    F: tuple[float, float]
    q: tuple[float, float, float]
    F_r: tuple[float, float]
    d: tuple[float, float]
    pressed: bool


def sample(case: Case, k: int) -> Sample:
    """Return smooth numbers that are independent of each other."""
    t, span = k * case.period_s, TICKS * case.period_s
    w = 2.0 * pi / span
    return Sample(
        x=(30.0 + 3.0 * sin(5 * w * t), 29.0 - 2.0 * cos(3 * w * t)),
        H=(31.0 + 3.2 * sin(5 * w * t + 0.1), 30.5 - 2.3 * cos(3 * w * t - 0.2)),
        F=(8.0 + sin(7 * w * t), 8.3 + 1.5 * cos(6 * w * t)),
        q=(
            0.5 + 4.0 * sin(2 * w * t),
            8.0 * w * cos(2 * w * t),
            -16.0 * w * w * sin(2 * w * t),
        ),
        F_r=(9.0 + 4.0 * sin(3 * w * t), 12.0 * w * cos(3 * w * t)),
        d=(58.0 + 2.0 * t / span, 2.0 / span),
        pressed=TOUCHED <= k < LOST,
    )


class Filter:
    """F(z) as one difference equation."""

    def __init__(self, n: int, hz: float, period_s: float) -> None:
        self.n, self.p = n, exp(-2.0 * pi * hz * period_s)
        self.past: list[float] = []

    def hold(self, w: float) -> float:
        """Set the state as if w had always had this value."""
        self.past = [w] * self.n
        return w

    def take(self, w: float) -> float:
        y = (1.0 - self.p) ** self.n * w
        for j in range(1, self.n + 1):
            y -= (-1.0) ** j * comb(self.n, j) * self.p**j * self.past[-j]
        self.past.append(y)
        return y


def transcribed(case: Case) -> list[tuple[float, float]]:
    """Return X_1 and X_2 of every tick."""
    T, phi = case.period_s, max(0.0, case.delay_s / case.period_s - 0.5)
    kappa = exp(-T / case.lag_s) if case.lag_s > 0.0 else 0.0
    behind = T * kappa / (1.0 - kappa)
    place, total = (Filter(case.n, hz, T) for hz in (case.f_q, case.f_F))
    found: list[tuple[float, float]] = []
    older = lagging = (0.0, 0.0)
    lead, met = (0.0, 0.0), 0.0
    for k in range(TICKS):
        now = sample(case, k)
        if k == 0:
            bar = now.H
        else:
            aged = [(1.0 - phi) * now.H[i] + phi * older[i] for i in (0, 1)]
            bar = (
                aged[0] - kappa * (aged[0] - lagging[0]),
                aged[1] - kappa * (aged[1] - lagging[1]),
            )
        older, lagging = now.H, bar
        F_r, slope = now.F_r if now.pressed else (0.0, 0.0)
        met = F_r if k == 0 else met
        F = 0.5 * (now.F[0] - lead[0] / S[0] + now.F[1] + lead[1] / S[1])
        w_q = 0.5 * ((now.x[0] - bar[0]) - (now.x[1] - bar[1])) + 0.5 * (S[0] - S[1]) * met
        if now.pressed:
            w_b = (S[0] + S[1] + C) * F - bar[0] - bar[1]
        else:
            w_b = (now.x[0] - bar[0]) + (now.x[1] - bar[1])
        W_q = place.hold(w_q) if k == 0 else place.take(w_q)
        W_b = total.hold(w_b) if k in (0, TOUCHED, LOST) else total.take(w_b)
        q, v, a = now.q
        q_later, v_later = q + phi * T * v + 0.5 * (phi * T) ** 2 * a, v + phi * T * a
        ahead = [
            (2.0 * ZETAS[i] / OMEGAS[i] + behind) * v_later + a / OMEGAS[i] ** 2 for i in (0, 1)
        ]
        lead = (
            2.0 * ZETAS[0] / OMEGAS[0] * v + a / OMEGAS[0] ** 2,
            2.0 * ZETAS[1] / OMEGAS[1] * v + a / OMEGAS[1] ** 2,
        )
        if now.pressed:
            half = 0.5 * (S[0] + S[1] + C) * (F_r + (phi * T + behind) * slope)
        else:
            half = 0.5 * (now.d[0] + (phi * T + behind) * now.d[1])
        uneven, met = 0.5 * (S[0] - S[1]) * F_r, F_r
        found.append(
            (
                q_later + half + uneven + ahead[0] - W_q - 0.5 * W_b,
                half - q_later - uneven - ahead[1] + W_q - 0.5 * W_b,
            )
        )
    return found


def write() -> None:
    """Write the golden vectors again."""
    made = {
        str(tuple(case)): {str(k): transcribed(case)[k] for k in GOLDEN_TICKS} for case in CASES
    }
    GOLDEN.write_text(json.dumps(made, indent=1) + "\n")


if __name__ == "__main__":
    write()
