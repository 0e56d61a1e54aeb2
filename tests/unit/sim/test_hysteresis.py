import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.sim.plant.hysteresis import BoucWen, advance_hysteresis, follow_voltages

SHAPE = BoucWen(A_um_per_V=9.0, b_per_V=1.04, g_per_V=0.26)
LEVELS = st.floats(-7.0, 7.0)
MOVES = st.floats(-4.0, 4.0)


@pytest.mark.parametrize("h_um", [-6.0, -1.0, 0.0, 2.0, 6.5])
@pytest.mark.parametrize("du_V", [-2.0, -0.3, 0.3, 2.0])
def test_the_hysteresis_satisfies_its_equation(h_um: float, du_V: float) -> None:
    steps = 50_000
    step_V = du_V / steps
    expected = h_um
    for _ in range(steps):
        middle = expected + 0.5 * _slope(expected, step_V)
        expected += _slope(middle, step_V)
    assert advance_hysteresis(SHAPE, h_um, du_V) == pytest.approx(expected, abs=1e-6)


def _slope(h_um: float, du_V: float) -> float:
    return 9.0 * du_V - 1.04 * abs(du_V) * h_um - 0.26 * du_V * abs(h_um)


@given(LEVELS, MOVES, st.floats(0.0, 1.0))
def test_a_monotone_voltage_change_may_be_split_anywhere(
    h_um: float, du_V: float, share: float
) -> None:
    whole = advance_hysteresis(SHAPE, h_um, du_V)
    first = advance_hysteresis(SHAPE, h_um, share * du_V)
    assert advance_hysteresis(SHAPE, first, (1.0 - share) * du_V) == pytest.approx(whole, abs=1e-9)


@given(LEVELS, MOVES)
def test_the_hysteresis_is_odd_and_bounded(h_um: float, du_V: float) -> None:
    after = advance_hysteresis(SHAPE, h_um, du_V)
    assert advance_hysteresis(SHAPE, -h_um, -du_V) == -after
    assert abs(after) <= max(abs(h_um), 9.0 / (1.04 + 0.26)) + 1e-9


@pytest.mark.parametrize("way_V", np.geomspace(1e-12, 2.0, 60).tolist())
def test_the_hysteresis_of_a_short_motion_is_as_exact_as_that_of_a_long_one(way_V: float) -> None:
    along = BoucWen(A_um_per_V=1.0, b_per_V=1.3, g_per_V=0.0)
    exact = -math.expm1(-1.3 * way_V) / 1.3
    assert advance_hysteresis(along, 0.0, way_V) == pytest.approx(exact, rel=5e-16, abs=0.0)


@pytest.mark.parametrize("seed", range(8))
def test_many_motions_computed_together_equal_single_ones(seed: int) -> None:
    chance = np.random.default_rng(seed)
    # Short and long motions, reversals and rests, more than are computed ahead.
    sizes = chance.choice([0.0, 1e-6, 1e-3, 0.02, 0.5, 2.0], 300) * chance.choice([-1.0, 1.0], 300)
    steps = np.where(chance.random(300) < 0.8, np.abs(sizes) * (-1.0) ** (seed % 2), sizes)
    voltages_V, levels_um = np.cumsum(steps).tolist(), [0.0] * 300
    h_um = before_V = 0.0
    one_by_one = list[float]()
    for voltage_V in voltages_V:
        h_um, before_V = advance_hysteresis(SHAPE, h_um, voltage_V - before_V), voltage_V
        one_by_one.append(h_um)
    assert follow_voltages(SHAPE, 0.0, 0.0, voltages_V, levels_um) == h_um
    assert levels_um == one_by_one


def test_a_repeated_voltage_cycle_gives_a_closed_hysteresis_loop() -> None:
    h_um, ends = 0.0, list[float]()
    for _ in range(12):
        h_um = advance_hysteresis(SHAPE, advance_hysteresis(SHAPE, h_um, 2.0), -2.0)
        ends.append(h_um)
    assert ends[-1] == pytest.approx(ends[-2], abs=1e-9)
    assert abs(ends[-1]) > 1.0


@pytest.mark.parametrize("asymmetry", [-0.15, 0.3])
@pytest.mark.parametrize("du_V", [-2.0, 2.0])
def test_b_of_an_asymmetric_hysteresis_depends_on_the_direction_of_the_voltage(
    asymmetry: float, du_V: float
) -> None:
    shape = BoucWen(9.0, 1.04, 0.26, asymmetry)
    b_per_V = 1.04 * (1.0 + asymmetry if du_V > 0.0 else 1.0 - asymmetry)
    one_way = BoucWen(9.0, b_per_V, 0.26)
    for h_um in (-6.0, 0.0, 3.0):
        assert advance_hysteresis(shape, h_um, du_V) == advance_hysteresis(one_way, h_um, du_V)


def test_an_asymmetric_cycle_closes_off_centre() -> None:
    shape, ends = BoucWen(9.0, 1.04, 0.26, 0.2), list[float]()
    h_um = 0.0
    for _ in range(15):
        top_um = advance_hysteresis(shape, h_um, 2.0)
        h_um = advance_hysteresis(shape, top_um, -2.0)
        ends.append(top_um + h_um)
    assert ends[-1] == pytest.approx(ends[-2], abs=1e-9)
    assert ends[-1] < -0.5
    symmetric = advance_hysteresis(SHAPE, 0.0, 2.0)
    assert symmetric == advance_hysteresis(BoucWen(9.0, 1.04, 0.26, 0.0), 0.0, 2.0)


def test_hysteresis_without_shape_parameters_is_a_straight_line() -> None:
    assert advance_hysteresis(BoucWen(9.0, 0.0, 0.0), -1.0, 0.5) == pytest.approx(3.5)


def test_an_unbounded_shape_is_refused() -> None:
    with pytest.raises(ValueError, match=r"b = 0\.1 per V is below \|g\| = 0\.2 per V"):
        BoucWen(1.0, 0.1, -0.2)
    with pytest.raises(ValueError, match=r"b = 0\.2 per V is below \|g\| = 0\.26 per V"):
        BoucWen(1.0, 1.0, 0.26, 0.8)
