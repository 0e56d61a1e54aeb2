"""The identified set: k·H(u) in the place of d·u in (17), beside a transcription of its own.

    .venv/bin/python -m tests.unit.control.laws.identified_case

writes the stored voltages anew, from the root of the checkout.
"""

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pincette.control.laws.law import Law, build, rebase, start, step
from pincette.control.laws.sliding import LawOutput
from pincette.control.response import hysteresis
from pincette.control.response.hysteresis import HysteresisModel, displacement_um
from pincette.control.response.inverse import TOLERANCE_UM
from tests.support.laws import in_order, law_settings, step_at

from .identified_case import (
    CASES,
    CURVATURE,
    D_P,
    FADINGS,
    GOLDEN,
    GOLDEN_TICKS,
    PERIOD_S,
    SHARES,
    THRESHOLDS_V,
    TIMES_S,
    WEIGHTS,
    actuators,
    golden,
    transcribed,
)
from .model_loop import ARM, SCHEMES, Loop, law_of, resting_arm
from .transcription import IMPEDANCE, PAST, TICKS, Case, signals

MODEL = HysteresisModel(THRESHOLDS_V, WEIGHTS, TIMES_S, SHARES, FADINGS, CURVATURE)
LINE = HysteresisModel((0.0,), (D_P,))
LEAST_SLOPE = 12.0
"""Smallest slope in µm/V, below that of ``MODEL`` at any voltage and after any reversal."""
PER_CASE = pytest.mark.parametrize("case", CASES, ids=str)
SOME = settings(deadline=None, max_examples=30, derandomize=True)


def identified(case: Case) -> Law:
    gains = in_order((case.K_P, case.K_I, case.K_S, case.delta, *IMPEDANCE))
    settings_ = law_settings(case.scheme, "identified", "newest", **gains)
    return build(settings_, ARM, PERIOD_S, 0.0, MODEL)


def play(case: Case) -> list[LawOutput]:
    columns, law = signals(), identified(case)
    memory = hysteresis.start(MODEL)
    memories = [memory := hysteresis.step(MODEL, memory, u, PERIOD_S) for u in columns["u"]]
    state = start(
        law,
        x_um=columns["x"][0],
        x_r_um=columns["x_r"][0],
        force_mN=columns["F"][0],
        applied_V=columns["u"][0],
        memory=memories[PAST - 2],
    )
    outputs: list[LawOutput] = []
    for i in range(PAST, PAST + TICKS):
        state, output = step_at(
            law,
            state,
            (columns["x"][i - 1], columns["F"][i], columns["u"][i - 1]),
            (columns["x_r"][i], columns["F_r"][i]),
            limited=int(columns["limited"][i]),
            memory=memories[i - 1],
        )
        outputs.append(output)
    return outputs


@PER_CASE
def test_every_tick_equals_the_transcription_of_the_paper(case: Case) -> None:
    for tick, (output, (voltage_V, row)) in enumerate(
        zip(play(case), transcribed(case), strict=True)
    ):
        assert output.voltage_V == pytest.approx(voltage_V, abs=TOLERANCE_UM / LEAST_SLOPE), tick
        for name in ("x_d_um", "error_um", "integral_um", "sliding_um", "perturbation_mN"):
            wanted, scale = row[name]
            assert getattr(output, name) == pytest.approx(float(wanted), abs=1e-9 * float(scale))
        if tick:  # the law cannot know what was applied before the first tick
            assert output.residual_um == pytest.approx(float(row["residual_um"][0]), abs=1e-9)


def test_the_stored_voltages_equal_the_transcription_and_the_law() -> None:
    stored = json.loads(GOLDEN.read_text(encoding="utf-8"))
    found = golden()
    assert stored.keys() == found.keys()
    for case in CASES:
        outputs = play(case)
        for tick in GOLDEN_TICKS:
            value = stored[str(case)][str(tick)]
            assert found[str(case)][str(tick)] == pytest.approx(value, rel=1e-9)
            assert outputs[tick].voltage_V == pytest.approx(value, abs=TOLERANCE_UM / LEAST_SLOPE)


def test_the_hysteresis_makes_the_law_differ_from_that_of_the_straight_line() -> None:
    """Conditions of the comparison: H is not linear, and the voltages reach both of its
    branches."""
    columns = signals()
    straight = build(law_settings("pbsmic", force_age="newest"), ARM, PERIOD_S, 0.0)
    at: dict[str, Any] = {
        "x_um": columns["x"][0],
        "x_r_um": columns["x_r"][0],
        "force_mN": columns["F"][0],
    }
    state = start(straight, **at, applied_V=columns["u"][0])
    apart: list[float] = []
    for i, output in enumerate(play(CASES[0]), start=PAST):
        state, of_line = step_at(
            straight,
            state,
            (columns["x"][i - 1], columns["F"][i], columns["u"][i - 1]),
            (columns["x_r"][i], columns["F_r"][i]),
            limited=int(columns["limited"][i]),
        )
        apart.append(output.voltage_V - of_line.voltage_V)
    assert max(apart) > 0.005
    assert min(apart) < -0.005
    displacements = [actuator.displacement for actuator in actuators()]
    assert max(displacements) - min(displacements) > 10.0


steps = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=30)


@SOME
@given(st.sampled_from(SCHEMES), steps, st.sampled_from([0.0, 0.5]), st.floats(0.0, 3.0))
def test_with_a_straight_line_the_law_equals_the_linear_law(
    scheme: str, ways_um: list[float], K_S: float, K_e: float
) -> None:
    """Equal bits are not possible: the line is inverted by search, to ``TOLERANCE_UM``."""
    gains: dict[str, Any] = {"K_S": K_S, "K_f": 2000.0, "delta": 2.0 if scheme == "pbsmic" else 4e4}
    line = build(law_settings(scheme, "identified", **gains), ARM, PERIOD_S, 0.03, LINE)
    today = Loop(law_of(law_settings(scheme, **gains), filter_s=0.03), resting_arm(20.0, K_e=K_e))
    arm = resting_arm(20.0, K_e=K_e)
    at = arm.voltage_V
    memory = hysteresis.step(LINE, hysteresis.start(LINE), at, PERIOD_S)
    state = start(line, x_um=20.0, x_r_um=20.0, force_mN=arm.force_mN, applied_V=at, memory=memory)
    x_r_um = 20.0
    for way_um in ways_um:
        x_r_um += way_um
        # Both see the arm of the law of the line, so that errors do not add up.
        same: dict[str, Any] = {"x_um": today.arm.x_um, "force_mN": today.arm.force_mN}
        memory = hysteresis.step(LINE, memory, today.arm.voltage_V, PERIOD_S)
        state, output = step(
            line,
            state,
            **same,
            applied_V=today.arm.voltage_V,
            x_r_um=x_r_um,
            force_r_mN=0.0,
            limited=0,
            memory=memory,
        )
        wanted = today.tick(x_r_um, 0.0)
        assert output.voltage_V == pytest.approx(wanted.voltage_V, abs=TOLERANCE_UM / D_P)
        assert output.sliding_um == pytest.approx(wanted.sliding_um, abs=1e-9)
        assert output.residual_um == pytest.approx(wanted.residual_um, abs=1e-9)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_laws_of_other_parameter_sets_do_not_use_the_identified_response(scheme: str) -> None:
    for name in ("consistent", "printed"):
        law = build(law_settings(scheme, name), ARM, PERIOD_S, 0.03, MODEL)
        assert law == build(law_settings(scheme, name), ARM, PERIOD_S, 0.03)


def test_the_identified_set_is_refused_without_a_response() -> None:
    with pytest.raises(ValueError, match="no free response is identified: calibrate"):
        build(law_settings("pbsmic", "identified"), ARM, PERIOD_S, 0.03)


def test_without_the_memory_of_the_response_the_law_cannot_start() -> None:
    law = identified(CASES[0])
    with pytest.raises(TypeError, match="needs the response's memory"):
        start(law, x_um=0.0, x_r_um=0.0, force_mN=0.0, applied_V=0.0)


def test_changing_from_the_straight_line_to_the_identified_response_causes_no_jump() -> None:
    """u and v differ; confusing them would give a residual of 0.2 µm."""
    line = law_of(law_settings("pbsmic"))
    law = build(law_settings("pbsmic", "identified"), ARM, PERIOD_S, 0.0, MODEL)
    memory = hysteresis.step(MODEL, hysteresis.start(MODEL), 1.5, PERIOD_S)
    at: dict[str, Any] = {"x_um": 30.0, "x_r_um": 30.0, "force_mN": 0.0}
    state = start(line, **at, applied_V=1.5)
    seen_V = displacement_um(MODEL, memory) / D_P
    assert abs(seen_V - 1.5) > 0.01
    state = rebase(law, state, **at, force_r_mN=0.0, seen_V=seen_V)
    _, output = step(law, state, **at, force_r_mN=0.0, applied_V=1.5, limited=0, memory=memory)
    assert output.residual_um == 0.0
    creep_V = abs(output.voltage_V - 1.5)
    assert creep_V < 0.02
