"""The law with a filtered perturbation: its transcription, PBSMIC as its first order, no bumps.

    .venv/bin/python -m tests.unit.control.laws.fpbsmic_case

writes the stored values anew, from the root of the checkout.
"""

import json
from itertools import pairwise
from math import exp, log, pi
from typing import Any

import pytest

from pincette.control.arm.plant import ArmParameters, OutputTiming, consistent_arm
from pincette.control.laws import law as control_law
from pincette.control.laws.fpbsmic import LAW, Cascade, passed
from pincette.control.laws.law import Law
from pincette.control.laws.planned_motion import RESTING, PlannedMotion
from pincette.control.laws.sliding import LawOutput
from tests.support.laws import law_settings, step_at

from .fpbsmic_case import (
    CASES,
    D_P,
    GOLDEN,
    K_F,
    OMEGA_N,
    S_P,
    TICKS,
    ZETA,
    Case,
    F_r_of,
    golden,
    samples,
    transcribed,
)

ARM = consistent_arm(OMEGA_N, ZETA, D_P, S_P)
MASSLESS = ArmParameters(0.0, 0.0, ARM.k, ARM.d)
PER_CASE = pytest.mark.parametrize("case", CASES, ids=str)


def law_of(case: Case, **gains: float) -> Law:
    own = {"n": float(case.n), "f_w": case.f_w, "K_f": K_F}
    settings = LAW.settings("consistent").with_gains(**(own | gains))
    return control_law.build(settings, ARM, case.period_s, 0.03, output=OutputTiming(case.delay_s))


def play(case: Case) -> list[LawOutput]:
    law, given = law_of(case), samples(case)
    first = given[0]
    at: dict[str, Any] = {"x_um": first.x, "x_r_um": first.x_r}
    state = control_law.start(law, **at, force_mN=0.0, applied_V=first.H / D_P)
    outputs: list[LawOutput] = []
    for tick, now in enumerate(given):
        before = given[tick - 1] if tick else None
        if before is not None and (before.K_e > 0.0) != (now.K_e > 0.0):
            r_mN = F_r_of(now, before) if now.K_e else 0.0
            at = {"x_um": now.x, "x_r_um": before.x_r, "force_mN": now.F, "force_r_mN": r_mN}
            state = control_law.rebase(law, state, **at)
        state, output = step_at(
            law,
            state,
            (now.x, now.F, now.H / D_P),
            (now.x_r, now.F_r),
            plan=PlannedMotion(now.v_r, now.a_r, now.K_e, now.x_e),
        )
        outputs.append(output)
    return outputs


@PER_CASE
def test_every_tick_equals_the_transcription_of_the_paper(case: Case) -> None:
    outputs, rows = play(case), transcribed(case)
    assert len(outputs) == len(rows) == TICKS
    for tick, (output, row) in enumerate(zip(outputs, rows, strict=True)):
        assert D_P * output.voltage_V == pytest.approx(row.wanted_um, abs=1e-9), tick
        assert output.x_d_um == pytest.approx(row.x_d, abs=1e-9), tick


def test_the_stored_values_equal_the_transcription_of_the_paper() -> None:
    stored, made = json.loads(GOLDEN.read_text(encoding="utf-8")), golden()
    assert stored.keys() == made.keys()
    for case, ticks in made.items():
        for tick, row in ticks.items():
            assert stored[case][tick] == pytest.approx(row, rel=1e-9, abs=1e-9), (case, tick)


@pytest.mark.parametrize("K_e", [0.0, 2.1])
@pytest.mark.parametrize("K_P", [0.5, 1.0, 5.0])
def test_with_one_pole_at_20_ms_the_law_equals_pbsmic(K_P: float, K_e: float) -> None:
    """For a massless arm, without a low-pass, with the contact's own force at the predicted
    position."""
    p, T, x_e = K_P / (K_P + 1.0), 0.02, 26.0
    old = control_law.build(law_settings(K_P=K_P, K_f=0.0, force_age="newest"), MASSLESS, T, 0.0)
    new = LAW.settings("consistent", n=1.0, f_w=-log(p) / (2.0 * pi * T), K_f=0.0)
    one = control_law.build(new, MASSLESS, T, 0.0)
    x, u = 30.0, 30.0 / D_P
    at: dict[str, Any] = {"x_um": x, "x_r_um": x, "applied_V": u}
    before = control_law.start(old, **at, force_mN=K_e * (x - x_e))
    state = control_law.start(one, **at, force_mN=K_e * (x - x_e))
    x_d = x
    for tick in range(200):
        x_r = 30.0 + 0.05 * tick + (1.0 if tick > 40 else 0.0)
        foreseen = x_r + p * (x - x_d)
        past: Any = before.law.history
        # F_{k-1} is that of x_{k-1}, which the law has met in the meantime.
        history = type(past)(past.x_2_um, past.x_3_um, K_e * (x - x_e), *_rest(past))
        inner = type(before.law)(history, *_but_first(before.law))
        before = type(before)(inner, before.x_d_um, before.force_r_mN, before.force_error_mN)
        given: dict[str, Any] = {"x_um": x, "x_r_um": x_r, "limited": 0, "applied_V": u}
        before, wanted = control_law.step(
            old, before, **given, force_mN=K_e * (foreseen - x_e), force_r_mN=0.0
        )
        state, found = control_law.step(
            one,
            state,
            **given,
            force_mN=0.0,
            force_r_mN=0.0,
            plan=PlannedMotion(K_e_mN_per_um=K_e, x_e_um=x_e),
        )
        assert found.voltage_V == pytest.approx(wanted.voltage_V, abs=1e-9), tick
        assert found.error_um == pytest.approx(wanted.error_um, abs=1e-9)
        # s of PBSMIC over K_P + K_I is that of the filter.
        assert found.sliding_um == pytest.approx(wanted.sliding_um / (K_P + 1.0), abs=1e-6)
        x_d, u = wanted.x_d_um, wanted.voltage_V
        # An arm whose slope is wrong by 8 %, and which drifts.
        x = (1.08 * D_P * u - 1.0 + 0.002 * tick + S_P * K_e * x_e) / (1.0 + S_P * K_e)


def _rest(history: Any) -> tuple[float, float]:
    return history.applied_V, history.coasting_um


def _but_first(state: Any) -> list[float]:
    return [getattr(state, name) for name in state.__struct_fields__[1:]]


@pytest.mark.parametrize("contact", [PlannedMotion(), PlannedMotion(K_e_mN_per_um=2.1, x_e_um=26)])
def test_the_law_starts_without_a_voltage_jump(contact: PlannedMotion) -> None:
    law = law_of(CASES[0])
    at: dict[str, Any] = {"x_um": 31.0, "x_r_um": 31.0}
    state = control_law.start(law, **at, force_mN=10.5, applied_V=1.9)
    for _ in range(20):
        state, output = control_law.step(
            law, state, **at, applied_V=1.9, force_mN=10.5, force_r_mN=10.5, limited=0, plan=contact
        )
        assert output.voltage_V == pytest.approx(1.9, abs=1e-12)


@pytest.mark.parametrize("pressed_mN", [0.0, 2.0])
def test_a_touch_and_its_loss_do_not_change_the_voltage(pressed_mN: float) -> None:
    """The law is informed that a part is in contact, and later that the contact is lost.

    The contact may have begun some time before: the filter has then absorbed the force.
    """
    law, x, v, T = law_of(CASES[0], K_f=2000.0), 30.0, 100.0, 0.001
    state = control_law.start(law, x_um=x, x_r_um=x, force_mN=0.0, applied_V=(x - 2.0) / D_P)
    volts = [(x - 2.0) / D_P]
    for tick in range(120):
        reported = 40 <= tick < 80
        K_e, x_e = (2.1, x - pressed_mN / 2.1) if reported else (0.0, 0.0)
        if tick in (40, 80):
            at: dict[str, Any] = {"x_um": x, "x_r_um": x, "force_mN": 0.0, "force_r_mN": 0.0}
            state = control_law.rebase(law, state, **at)
        plan = PlannedMotion(v, 0.0, K_e, x_e)
        state, output = step_at(
            law, state, (x, 0.0, volts[-1]), (x + v * T, K_e * v * T), plan=plan
        )
        volts.append(output.voltage_V)
        x += v * T
    steps = [D_P * (b - a) / (v * T) for a, b in pairwise(volts[20:])]
    # The change of voltage is limited to the travel of a tick times the part's stiffness, over the
    # tick and the delay.
    assert max(abs(step - 1.0) for step in steps) < S_P * 2.1 * 1.15 + 0.01


def test_a_cascade_of_low_passes_settles_at_its_input() -> None:
    p = exp(-2.0 * pi * 60.0 * 0.001)
    state, gone = Cascade(0.0, 0.0, 0.0, 0.0), list[float]()
    for _ in range(200):
        state = passed(Cascade(p, p, p, 0.0), state, 1.0)
        gone.append(state.four)
    assert gone[-1] == pytest.approx(1.0, abs=1e-12)
    assert gone[0] == pytest.approx((1.0 - p) ** 3)
    assert state.three == state.four


def test_impossible_filters_are_refused() -> None:
    for gains in ({"n": 2.5}, {"n": 5.0}):
        with pytest.raises(ValueError, match="whole number of poles from 1 to 4"):
            law_of(CASES[0], **gains)
    with pytest.raises(ValueError, match=r"delay of 1\.6 ms .* choose a longer period"):
        law_of(Case(0.001, 3, 60.0, 0.0016))
    with pytest.raises(ValueError, match="f_w"):
        LAW.settings("consistent", f_w=0.0)


def test_a_law_without_preview_ignores_the_planned_contact() -> None:
    law = control_law.build(law_settings(), ARM, 0.02, 0.03)
    at: dict[str, Any] = {"x_um": 30.0, "x_r_um": 30.5, "force_mN": 0.0, "applied_V": 1.5}
    state = control_law.start(law, **at)
    found = control_law.step(law, state, **at, force_r_mN=0.0, limited=0, plan=RESTING)
    assert found == control_law.step(law, state, **at, force_r_mN=0.0, limited=0)
