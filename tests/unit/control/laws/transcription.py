"""(25) and (42) as they are printed, in 50 digits, term by term, with nothing shortened.

Q. Xu, IEEE T-ASE 10(3), 2013, with (4) to (6), (8), (12), (13), (16) to (19), (32) to (35).
Lists run over the samples k; sample 0 is the first that the law computes, at ``PAST``, and what
comes before it is rest. ``sgn`` is taken as ``sat`` (32).
"""

import json
import random
from dataclasses import dataclass
from decimal import Decimal, localcontext
from math import sin
from pathlib import Path
from typing import Literal

GOLDEN = Path(__file__).parent / "golden" / "laws.json"
GOLDEN_TICKS = (1, 60, 219)
DIGITS = 50
TICKS = 220
PAST = 5
"""Samples of rest before the first tick: p̃_{k-1} (8) reaches back to x_{k-4}."""
ARMS = {
    # ω_n = 2437.8 rad/s, ζ = 0.026, d_p = 19 µm/V, s_p = 0.46 µm/mN: k = 1/s_p, m = k/ω_n²,
    # b = 2ζω_n·m, d = d_p·k.
    "consistent": (
        1.0 / 0.46 / 2437.8**2,
        2.0 * 0.026 * 2437.8 * (1.0 / 0.46 / 2437.8**2),
        1.0 / 0.46,
        19.0 * (1.0 / 0.46),
    ),
    "printed": (1.8e-3, 126.8, 5.943e6, 1.129e8),
}
IMPEDANCE = (1e-3, 8.9221, 1.9901e4, 5000.0)
"""M, B, K, K_f of the impedance."""
GAINS = {
    # K_P, K_I, K_S in mN, δ in µm (PBSMIC) or mN (DSMIFC). The first row of a printed set is the
    # paper's; the others make the switching term count, in and beyond the boundary layer.
    ("pbsmic", "consistent"): [(5.0, 1.0, 0.0, 100.0), (0.5, 1.0, 0.5, 2.0), (1.0, 2.0, 5.0, 3.0)],
    ("pbsmic", "printed"): [(5.0, 1.0, 0.003, 100.0), (0.5, 1.0, 1e6, 2.0), (1.0, 2.0, 1e7, 3.0)],
    ("dsmifc", "consistent"): [(2.0, 1.0, 0.0, 1e6), (0.5, 1.0, 0.5, 4e4), (1.0, 2.0, 5.0, 6e4)],
    ("dsmifc", "printed"): [(2.0, 1.0, 1e3, 1e6), (0.5, 1.0, 1e6, 4e4), (1.0, 2.0, 1e7, 6e4)],
}
Scheme = Literal["pbsmic", "dsmifc"]
ParameterSet = Literal["consistent", "printed"]
Row = dict[str, tuple[Decimal, Decimal]]
"""Outputs of the law in one tick, named as in LawOutput: value and scale."""


@dataclass(frozen=True, slots=True)
class Case:
    scheme: Scheme
    set: ParameterSet
    period_s: float
    K_P: float
    K_I: float
    K_S: float
    delta: float

    def __str__(self) -> str:
        gains = f"K_P={self.K_P:g} K_I={self.K_I:g} K_S={self.K_S:g} delta={self.delta:g}"
        return f"{self.scheme} {self.set} T={self.period_s:g} {gains}"


SCHEMES: tuple[Scheme, ...] = ("pbsmic", "dsmifc")
SETS: tuple[ParameterSet, ...] = ("consistent", "printed")
CASES = [
    Case(scheme, name, period_s, *gains)
    for scheme in SCHEMES
    for name in SETS
    for period_s in (0.02, 0.001)
    for gains in GAINS[scheme, name]
]


def signals(seed: int = 7) -> dict[str, list[float]]:
    """Return measured, applied and reference signals: smooth motion with noise after a rest."""
    draw = random.Random(seed)
    columns: dict[str, list[float]] = {name: [] for name in ("x", "x_r", "F", "F_r", "u")}
    columns["limited"] = []
    for tick in range(-PAST, TICKS):
        t, moving = 0.02 * tick, 1.0 if tick >= 0 else 0.0
        noise = [moving * draw.gauss(0.0, 1.0) for _ in range(4)]
        columns["x"].append(30.0 + moving * 4.0 * sin(3.0 * t) + 0.1 * noise[0])
        columns["x_r"].append(30.1 + moving * (4.2 * sin(3.0 * t + 0.05) - 0.1))
        columns["F"].append(8.0 + moving * 5.0 * sin(3.0 * t) + 0.2 * noise[1])
        columns["F_r"].append(8.0 + moving * 5.0 * sin(3.0 * t + 0.1) + 0.1 * noise[2])
        columns["u"].append(1.5 + moving * 0.4 * sin(3.0 * t) + 0.01 * noise[3])
        columns["limited"].append(moving * ((sin(7.0 * t) > 0.8) - (sin(7.0 * t) < -0.8)))
    return columns


def transcribe(case: Case, given: dict[str, list[float]]) -> list[Row]:
    """Compute every tick of the law."""
    with localcontext(prec=DIGITS):
        columns = {name: [Decimal(value) for value in values] for name, values in given.items()}
        return _pbsmic(case, columns) if case.scheme == "pbsmic" else _dsmifc(case, columns)


def plant_coefficients(case: Case) -> tuple[Decimal, Decimal, Decimal, Decimal]:
    """Return m̄, b̄, k̄, d̄ (5)."""
    m, b, k, d = (Decimal(value) for value in ARMS[case.set])
    T = Decimal(case.period_s)
    return m / T**2, -2 * m / T**2 - b / T, m / T**2 + b / T + k, d


def impedance_coefficients(case: Case) -> tuple[Decimal, Decimal, Decimal, Decimal]:
    """Return M̄, B̄, K̄, K̄_f (13)."""
    M, B, K, K_f = (Decimal(value) for value in IMPEDANCE)
    T = Decimal(case.period_s)
    return M / T**2, -2 * M / T**2 - B / T, M / T**2 + B / T + K, K_f


def sat(s: Decimal, delta: Decimal) -> Decimal:
    """Return the saturation (32)."""
    if abs(s) <= delta:
        return s / delta
    return Decimal(1) if s > 0 else Decimal(-1)


def _pbsmic(case: Case, given: dict[str, list[Decimal]]) -> list[Row]:
    m, b, k, d = plant_coefficients(case)
    M, B, K, Kf = impedance_coefficients(case)
    KP, KI, KS, delta = (Decimal(v) for v in (case.K_P, case.K_I, case.K_S, case.delta))
    Ga = KP + KI
    x, xr, F, Fr, u = (given[name] for name in ("x", "x_r", "F", "F_r", "u"))
    size = len(x)
    xd, e, eps, s = (list(x), *([Decimal(0)] * size for _ in range(3)))
    scale = Decimal(0)
    rows: list[Row] = []
    for i in range(PAST, size):
        xd[i] = (
            -(M / K) * (xd[i - 2] - xr[i - 2])
            - (B / K) * (xd[i - 1] - xr[i - 1])
            - (Kf / K) * (F[i] - Fr[i])
            + xr[i]
        )
        e[i - 1] = x[i - 1] - xd[i - 1]
        frozen = given["limited"][i] * e[i - 1] < 0
        eps[i - 1] = eps[i - 2] if frozen else eps[i - 2] + e[i - 1]
        s[i - 1] = KP * e[i - 1] + KI * eps[i - 1]
        u_k = (
            u[i - 1]
            + 1 / d * (k / Ga * s[i - 1] - k / Ga * KI * eps[i - 1] + k * xd[i])
            - 1 / d * (m * x[i - 3] + (b - m) * x[i - 2] + (k - b) * x[i - 1] - (F[i] - F[i - 1]))
            - KS / d * sat(s[i - 1], delta)
        )
        e_scale = abs(x[i - 1]) + abs(xd[i - 1])
        scale = max(scale, abs(eps[i - 1])) + abs(e[i - 1])
        row = _past(case, given, i)
        row["voltage_V"] = (u_k, abs(u_k))
        row["x_d_um"] = (xd[i], abs(xd[i]))
        row["error_um"] = (e[i - 1], e_scale)
        row["integral_um"] = (eps[i - 1], e_scale + scale)
        row["sliding_um"] = (s[i - 1], KP * e_scale + KI * (e_scale + scale))
        rows.append(row)
    return rows


def _dsmifc(case: Case, given: dict[str, list[Decimal]]) -> list[Row]:
    m, b, k, d = plant_coefficients(case)
    M, B, K, Kf = impedance_coefficients(case)
    KP, KI, KS, delta = (Decimal(v) for v in (case.K_P, case.K_I, case.K_S, case.delta))
    Ga = KP + KI
    x, xr, F, Fr, u = (given[name] for name in ("x", "x_r", "F", "F_r", "u"))
    size = len(x)
    et = [x[i] - xr[i] for i in range(size)]
    eps, zeta, s = ([Decimal(0)] * size for _ in range(3))
    scale = Decimal(0)
    rows: list[Row] = []
    for i in range(PAST, size):
        terms = (M * et[i - 3], B * et[i - 2], K * et[i - 1], Kf * (F[i - 1] - Fr[i - 1]))
        eps[i - 1] = terms[0] + terms[1] + terms[2] + terms[3]
        frozen = given["limited"][i] * eps[i - 1] < 0
        zeta[i - 1] = zeta[i - 2] if frozen else zeta[i - 2] + eps[i - 1]
        s[i - 1] = KP * eps[i - 1] + KI * zeta[i - 1]
        u_k = (
            u[i - 1]
            + k / (Ga * K * d) * (s[i - 1] - KI * zeta[i - 1])
            - k / (K * d) * (M * et[i - 2] + B * et[i - 1] + Kf * (F[i] - Fr[i]))
            - 1 / d * (m * x[i - 3] + (b - m) * x[i - 2] + (k - b) * x[i - 1] - (F[i] - F[i - 1]))
            + k / d * xr[i]
            - KS / d * sat(s[i - 1], delta)
        )
        # Position with which (33) vanishes at k: (12) solved for x_k.
        x_d = xr[i] - (M * et[i - 2] + B * et[i - 1] + Kf * (F[i] - Fr[i])) / K
        e_scale = abs(x[i - 1]) + abs(xr[i - 1]) + sum(abs(term) for term in terms) / K
        scale = max(scale, abs(zeta[i - 1] / K)) + abs(eps[i - 1] / K)
        row = _past(case, given, i)
        row["voltage_V"] = (u_k, abs(u_k))
        row["x_d_um"] = (x_d, abs(x_d))
        row["error_um"] = (eps[i - 1] / K, e_scale)
        row["integral_um"] = (zeta[i - 1] / K, e_scale + scale)
        row["sliding_um"] = (s[i - 1] / K, KP * e_scale + KI * (e_scale + scale))
        rows.append(row)
    return rows


def position_by_17(
    case: Case, given: dict[str, list[Decimal]], i: int, p_error: Decimal = Decimal(0)
) -> Decimal:
    """Return the position by (17) for sample i."""
    m, b, k, d = plant_coefficients(case)
    x, F, u = given["x"], given["F"], given["u"]
    return (1 / k) * (
        d * (u[i] - u[i - 1])
        + m * x[i - 3]
        + (b - m) * x[i - 2]
        + (k - b) * x[i - 1]
        - (F[i] - F[i - 1])
        - p_error
    )


def _past(case: Case, given: dict[str, list[Decimal]], i: int) -> Row:
    """p̂_k (6), p̃_{k-1} (8), the residual of (17), and the band of Theorem 1 or 2, over K̄."""
    m, b, k, d = plant_coefficients(case)
    x, F, u = given["x"], given["F"], given["u"]

    def p(j: int) -> tuple[Decimal, Decimal]:
        terms = (-d * u[j], m * x[j - 2], b * x[j - 1], k * x[j], F[j])
        return sum(terms, Decimal(0)), sum((abs(term) for term in terms), Decimal(0))

    (p_1, scale), (p_2, _) = p(i - 1), p(i - 2)
    error = p_2 - p_1
    a = (Decimal(case.K_P) + Decimal(case.K_I)) / k
    return {
        "perturbation_mN": (p_1, scale),
        "perturbation_error_mN": (error, scale),
        "residual_um": (x[i - 1] - position_by_17(case, given, i - 1), abs(x[i - 1])),
        "band_um": (a * (Decimal(case.K_S) + abs(error)) / 2, a * scale),
    }


def golden() -> dict[str, dict[str, dict[str, float]]]:
    """Return a few ticks of every case."""
    given = signals()
    table: dict[str, dict[str, dict[str, float]]] = {}
    for case in CASES:
        rows = transcribe(case, given)
        table[str(case)] = {
            str(tick): {name: float(value) for name, (value, _) in rows[tick].items()}
            for tick in GOLDEN_TICKS
        }
    return table


if __name__ == "__main__":
    GOLDEN.parent.mkdir(exist_ok=True)
    GOLDEN.write_text(json.dumps(golden(), indent=1) + "\n", encoding="utf-8")
