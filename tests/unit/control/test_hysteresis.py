"""The Prandtl-Ishlinskii operator and its creep, against their definitions."""

from dataclasses import replace
from math import exp, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.control.hysteresis import (
    HysteresisModel,
    HysteresisState,
    displacement_um,
    start,
    step,
)

PLAYS = HysteresisModel((0.0, 0.5, 1.0), (10.0, 4.0, 2.0))
CREEPING = replace(PLAYS, creep_times_s=(0.1, 10.0), creep_fractions=(0.05, 0.02))
VOLTAGES = st.lists(st.floats(-2.0, 3.0), min_size=1, max_size=20)


def follow(model: HysteresisModel, *voltages_V: float, dt_s: float = 0.0) -> HysteresisState:
    state = start(model)
    for voltage in voltages_V:
        state = step(model, state, voltage, dt_s)
    return state


def position(*voltages_V: float) -> float:
    return displacement_um(PLAYS, follow(PLAYS, *voltages_V))


def test_first_stroke_and_the_way_back() -> None:
    assert position(2.0) == pytest.approx(10 * 2.0 + 4 * 1.5 + 2 * 1.0)
    # On the way back a play moves only after 2r.
    assert position(2.0, 1.2) == pytest.approx(10 * 1.2 + 4 * 1.5 + 2 * 1.0)
    assert position(2.0, 0.0) == pytest.approx(10 * 0.0 + 4 * 0.5 + 2 * 1.0)


def test_a_minor_loop_closes_and_is_wiped_out() -> None:
    assert position(2.0, 1.0, 1.6, 1.0) == pytest.approx(position(2.0, 1.0))
    assert position(1.0, 0.2, 0.8, 2.0) == pytest.approx(position(2.0))


@given(VOLTAGES)
def test_rate_independent(voltages: list[float]) -> None:
    halves: list[float] = []
    before = 0.0
    for voltage in voltages:
        halves += [0.5 * (before + voltage), voltage]
        before = voltage
    assert position(*halves) == pytest.approx(position(*voltages), abs=1e-9)


@given(VOLTAGES)
def test_odd(voltages: list[float]) -> None:
    assert position(*[-voltage for voltage in voltages]) == pytest.approx(-position(*voltages))


def test_creep_is_exact_however_the_time_is_cut() -> None:
    once = step(CREEPING, start(CREEPING), 1.0, 4.0)
    cut = follow(CREEPING, *[1.0] * 200, dt_s=0.02)
    static = position(1.0)
    expected = static * (1.0 + 0.05 * (1 - exp(-40.0)) + 0.02 * (1 - exp(-0.4)))
    assert displacement_um(CREEPING, once) == pytest.approx(expected)
    assert displacement_um(CREEPING, cut) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("model", "text"),
    [
        (((0.0, 0.5), (1.0,)), "1 weights_um_per_V, must be 2"),
        (((0.1,), (1.0,)), "the first must be 0 V"),
        (((), ()), "the first must be 0 V"),
        (((0.0, 0.5, 0.5), (1.0, 1.0, 1.0)), "threshold 0.5 V, must be above 0.5 V"),
        (((0.0, nan), (1.0, 1.0)), "threshold = nan V"),
        (((0.0, 0.5), (1.0, -1.5)), "slope up to 0.5 V = -0.5 µm/V"),
        (((0.0,), (1.0,), (1.0,), ()), "0 creep_fractions, must be 1"),
        (((0.0,), (1.0,), (0.0,), (0.1,)), "creep time = 0.0 s"),
        (((0.0,), (1.0,), (1.0,), (nan,)), "creep fraction nan"),
    ],
)
def test_impossible_models_are_refused(model: tuple[tuple[float, ...], ...], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        HysteresisModel(*model)
