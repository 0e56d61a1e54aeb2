"""Both laws beside their transcription from the printed (25) and (42), and beside stored values.

The stored values are of the transcription, so that a change in both at once is noticed:

    .venv/bin/python -m tests.unit.control.laws.transcription

writes them anew, from the root of the checkout.
"""

import json
from decimal import Decimal, localcontext
from itertools import pairwise

import pytest

from pincette.control.arm.plant import consistent_arm, predict_position
from pincette.control.laws.law import Law, build, start
from pincette.control.laws.sliding import LawOutput
from tests.support.laws import in_order, law_settings, step_at

from .transcription import (
    ARMS,
    CASES,
    DIGITS,
    GOLDEN,
    IMPEDANCE,
    PAST,
    TICKS,
    Case,
    golden,
    impedance_coefficients,
    plant_coefficients,
    position_by_17,
    sat,
    signals,
    transcribe,
)

TOLERANCE = Decimal("1e-12")
"""Of the value of u_k and x_d, which stay far from 0. What passes through 0 is a difference of
larger numbers and is held to 1e-12 of those: e of the two positions, ε and ζ of the largest value
they have had, s of both, p̂ and p̃ of the terms of (6), the residual of the position."""
PER_CASE = pytest.mark.parametrize("case", CASES, ids=str)
ARM = consistent_arm(2437.8, 0.026, 19.0, 0.46)


def law_of(case: Case) -> Law:
    M, B, K, K_f = IMPEDANCE
    gains = (case.K_P, case.K_I, case.K_S, case.delta)
    settings = law_settings(case.scheme, case.set, "newest", **in_order((*gains, M, B, K, K_f)))
    return build(settings, ARM, case.period_s, 0.0)


def play(case: Case) -> list[LawOutput]:
    given, law = signals(), law_of(case)
    state = start(
        law,
        x_um=given["x"][0],
        x_r_um=given["x_r"][0],
        force_mN=given["F"][0],
        applied_V=given["u"][0],
    )
    outputs: list[LawOutput] = []
    for i in range(PAST, PAST + TICKS):
        state, output = step_at(
            law,
            state,
            (given["x"][i - 1], given["F"][i], given["u"][i - 1]),
            (given["x_r"][i], given["F_r"][i]),
            limited=int(given["limited"][i]),
        )
        outputs.append(output)
    return outputs


@PER_CASE
def test_a_law_equals_its_transcription(case: Case) -> None:
    outputs, rows = play(case), transcribe(case, signals())
    assert len(outputs) == len(rows) == TICKS
    for tick, (output, row) in enumerate(zip(outputs, rows, strict=True)):
        for name, (value, scale) in row.items():
            found = getattr(output, name)
            assert abs(Decimal(found) - value) <= TOLERANCE * scale, (tick, name, found, value)


def test_the_stored_values_equal_the_transcription_of_the_paper() -> None:
    stored, made = json.loads(GOLDEN.read_text(encoding="utf-8")), golden()
    assert stored.keys() == made.keys()
    for case, ticks in made.items():
        for tick, row in ticks.items():
            # sin() may differ in its last digit between machines.
            assert stored[case][tick] == pytest.approx(row, rel=1e-9, abs=1e-9), (case, tick)


@PER_CASE
def test_the_cases_lie_inside_and_outside_the_boundary_layer(case: Case) -> None:
    """Conditions of the comparison: u far from 0, a frozen ε or ζ, both parts of sat."""
    given, outputs = signals(), play(case)
    assert min(abs(output.voltage_V) for output in outputs) > 0.3
    frozen = [
        after.integral_um == before.integral_um and after.error_um != 0.0
        for before, after in pairwise(outputs)
    ]
    limited = [limit != 0.0 for limit in given["limited"][PAST:]]
    assert 10 < sum(frozen) < sum(limited)
    K_bar = 1.0 if case.scheme == "pbsmic" else float(impedance_coefficients(case)[2])
    shares = [K_bar * output.sliding_um / case.delta for output in outputs]
    above, below = sum(share > 1.0 for share in shares), sum(share < -1.0 for share in shares)
    if case in CASES[0::3]:
        assert above == below == 0
    else:
        assert min(above, below, TICKS - above - below) > 20


@PER_CASE
def test_the_prediction_is_equation_17(case: Case) -> None:
    plant, given = law_of(case).parameters.plant, signals()
    with localcontext(prec=DIGITS):
        columns = {name: [Decimal(value) for value in values] for name, values in given.items()}
        for i in range(PAST, PAST + TICKS):
            found = predict_position(
                plant,
                voltage_step_V=given["u"][i] - given["u"][i - 1],
                x_1_um=given["x"][i - 1],
                x_2_um=given["x"][i - 2],
                x_3_um=given["x"][i - 3],
                force_step_mN=given["F"][i] - given["F"][i - 1],
            )
            wanted = position_by_17(case, columns, i)
            assert abs(Decimal(found) - wanted) <= TOLERANCE * abs(wanted)


@pytest.mark.parametrize("case", [case for case in CASES if case.scheme == "dsmifc"], ids=str)
def test_equation_45_needs_the_factor_that_is_missing_in_print(case: Case) -> None:
    """x_k from (17) under u_k (42) and some p̃_k, put into (43): s_k is s_{k-1} -
    G̃_a·(K̄/k̄)[K̃_S sat(s_{k-1}) + p̃_k] to 30 digits; G̃_a is 1.5 to 3 here, and 1 in the print."""
    given = signals()
    rows = transcribe(case, given)
    with localcontext(prec=DIGITS):
        k = plant_coefficients(case)[2]
        M, B, K, Kf = impedance_coefficients(case)
        KP, KI, KS, delta = (Decimal(v) for v in (case.K_P, case.K_I, case.K_S, case.delta))
        Ga = KP + KI
        columns = {name: [Decimal(value) for value in values] for name, values in given.items()}
        x, xr, F, Fr = (columns[name] for name in ("x", "x_r", "F", "F_r"))
        for tick in (0, 3, 50, 111, 219):
            i = PAST + tick
            p_error = Decimal(tick - 80) * k / 1000
            columns["u"][i] = rows[tick]["voltage_V"][0]
            x_k = position_by_17(case, columns, i, p_error)
            columns["u"][i] = Decimal(given["u"][i])
            eps = (
                M * (x[i - 2] - xr[i - 2])
                + B * (x[i - 1] - xr[i - 1])
                + K * (x_k - xr[i])
                + Kf * (F[i] - Fr[i])
            )
            zeta_1, s_1 = rows[tick]["integral_um"][0] * K, rows[tick]["sliding_um"][0] * K
            s_k = Ga * eps + KI * zeta_1
            reaching = K / k * (KS * sat(s_1, delta) + p_error)
            assert abs((s_1 - s_k) / reaching - Ga) < Decimal("1e-30")


def test_the_transcription_uses_the_parameter_sets_of_the_laws() -> None:
    """The transcription has its own m, b, k, d: they must equal those of the laws."""
    m, b, k, d = ARMS["consistent"]
    assert (ARM.m, ARM.b, ARM.k, ARM.d) == (m, b, k, d)
