"""F1 to F7 of the law with a filtered perturbation, transcribed: floats, in the printed w.

The law keeps W = S·w; here the filter's state is w's own and is rescaled where S changes.
"""

import json
from math import cos, exp, pi, sin
from pathlib import Path
from typing import NamedTuple

GOLDEN = Path(__file__).parent / "golden" / "fpbsmic.json"
GOLDEN_TICKS = (0, 1, 59, 60, 180, 299)
TICKS = 300
OMEGA_N, ZETA, D_P, S_P = 2437.8, 0.026, 19.0, 0.46
M, B, K, K_F = 1e-3, 8.9221, 1.9901e4, 2000.0
TOUCHED, LOST, STIFFER = 60, 240, 120
"""Ticks at which a contact is reported, is lost, and is reported to be harder."""


class Case(NamedTuple):
    period_s: float
    n: int
    f_w: float
    delay_s: float


CASES = [
    Case(0.001, 3, 60.0, 0.00065),
    Case(0.001, 4, 100.0, 0.001),
    Case(0.0005, 4, 150.0, 0.0003),
    Case(0.00025, 2, 60.0, 0.0001),
    Case(0.0025, 1, 5.0, 0.0035),
    Case(0.02, 1, 5.5, 0.005),
]


class Sample(NamedTuple):
    """Inputs of a tick."""

    x: float
    H: float
    F: float
    x_r: float
    v_r: float
    a_r: float
    K_e: float
    x_e: float

    @property
    def F_r(self) -> float:
        """F_r of the next sample."""
        return self.K_e * (self.x_r - self.x_e)


def reference(case: Case, t: float) -> tuple[float, float, float]:
    """x_r, ẋ_r, ẍ_r: a parabola, which the law's own series meets exactly."""
    span = TICKS * case.period_s
    return 28.0 + 8.0 * (t / span) ** 2, 16.0 * t / span**2, 16.0 / span**2


def samples(case: Case) -> list[Sample]:
    """Return smooth signals with reversals, free, pressed, pressed harder, free again."""
    rows: list[Sample] = []
    for tick in range(TICKS):
        t = tick * case.period_s
        K_e, x_e = 0.0, 0.0
        if tick in range(TOUCHED, LOST):
            K_e, x_e = (2.6, 27.2) if tick >= STIFFER else (2.1, 27.0)
        x_r, v_r, a_r = reference(case, t + case.period_s)
        x = reference(case, t)[0] + 0.03 * sin(1.7 * tick * tick)
        F = K_e * (x - x_e) + 0.2 * cos(0.9 * tick) if K_e else 0.0
        H = x + 0.4 * sin(0.05 * tick) + S_P * F - 5.0
        rows.append(Sample(x, H, F, x_r, v_r, a_r, K_e, x_e))
    return rows


class Row(NamedTuple):
    """u_k as H(u_k), x_d, ŵ_k and F̂_k - F_r,k."""

    wanted_um: float
    x_d: float
    w_hat: float
    force_error: float


def F_r_of(now: Sample, before: Sample | None) -> float:
    """F_r of the present sample: at a contact F is used, and F_r starts from it."""
    if before is None or before.K_e == 0.0:
        return now.F
    return before.F_r


def transcribed(case: Case, f_F: float = 3.0) -> list[Row]:
    T, n = case.period_s, case.n
    p, q = exp(-2.0 * pi * case.f_w * T), exp(-2.0 * pi * f_F * T)
    delta = case.delay_s / T
    phi = max(0.0, delta - 0.5)
    K_bar = M / T**2 + B / T + K
    given = samples(case)
    rows: list[Row] = []
    w_stages, F_stages, low = [0.0] * n, [0.0] * n, 0.0
    deviations = [given[0].x - given[0].x_r] * 2
    S_before = 1.0
    for k, now in enumerate(given):
        before = given[k - 1] if k else None
        kappa = S_P * now.K_e
        S = 1.0 + kappa
        switched = before is not None and (before.K_e > 0.0) != (now.K_e > 0.0)
        if abs(S - S_before) > 0.0:  # contact: the state of F4 ← /S; lost: the reverse
            w_stages = [stage * S_before / S for stage in w_stages]
            S_before = S
        # The references of x_k are those that were set for it one tick ago.
        v, a = (before.v_r, before.a_r) if before else (0.0, 0.0)
        lead = 2.0 * ZETA / OMEGA_N * v + a / OMEGA_N**2
        # F1, F2
        H_bar = (1.0 - phi) * now.H + phi * (before.H if before else now.H)
        # F3, F4
        w = now.x - (H_bar + kappa * now.x_e) / S
        if k == 0:
            w_stages = [w] * n
        value = w
        for stage in range(n):
            if k:
                w_stages[stage] = p * w_stages[stage] + (1.0 - p) * value
            value = w_stages[stage]
        w_hat = value
        # F7, in deviations from F_r
        value = now.F - F_r_of(now, before) - lead / S_P if now.K_e else 0.0
        for stage in range(n):
            F_stages[stage] = p * F_stages[stage] + (1.0 - p) * value
            value = F_stages[stage]
        low = q * low + (1.0 - q) * value
        # x_d by (16)
        x_d = now.x_r + (M / T**2 * (2.0 * deviations[0] - deviations[1])) / K_bar
        x_d += (B / T * deviations[0] - K_F * low) / K_bar
        deviations = [x_d - now.x_r, deviations[0]]
        # F5: the plan at (k + δ + ½)T, which is φT after k + 1
        _, v_u, a_u = reference(case, (k + 1) * T + phi * T)
        ahead = reference(case, (k + 1) * T + phi * T)[0] - now.x_r
        x_ff = x_d + ahead + (2.0 * ZETA / OMEGA_N * v_u + a_u / OMEGA_N**2) / S
        # F6
        wanted = S * (x_ff - w_hat) - kappa * now.x_e
        if switched:  # H(u) follows the plan; ŵ absorbs the remaining jump
            jump = wanted - (now.H + T * now.v_r)
            w_stages = [stage + jump / S for stage in w_stages]
            w_hat, wanted = w_stages[-1], wanted - jump
        rows.append(Row(wanted, x_d, w_hat, value))
    return rows


def golden() -> dict[str, dict[str, list[float]]]:
    return {
        str(tuple(case)): {str(tick): list(transcribed(case)[tick]) for tick in GOLDEN_TICKS}
        for case in CASES
    }


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps(golden(), indent=1) + "\n", encoding="utf-8")
