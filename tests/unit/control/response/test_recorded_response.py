"""Recorded free response: Madelung's rules, a bounded memory, and branches that leave a recorded
motion."""

from itertools import pairwise
from math import cos, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.hysteresis_motion import Column, simulate
from pincette.control.response.recorded_response import (
    IGNORED_V,
    MOST_TURNS,
    RecordedBranches,
    RecordedResponse,
    Turn,
    recorded_response,
)
from pincette.control.response.recording import record_free_response

BENT = tuple((k / 8) ** 1.5 for k in range(9))
BRANCHES = RecordedBranches(Turn(-0.5, -8.0), Turn(2.5, 52.0), BENT, BENT)
FRESH = recorded_response(BRANCHES, 19.0, 0.2)
MODEL = HysteresisModel((0.0, 0.5, 1.0), (12.0, 5.0, 3.0))


def driven(response: RecordedResponse, *voltages_V: float) -> RecordedResponse:
    for voltage in voltages_V:
        response = response.updated(voltage, 0.02)
    return response


def ramp(*ends_V: float, step_V: float = 0.02) -> list[float]:
    """Return straight lines from one end to the next."""
    voltages: list[float] = []
    for start, end in pairwise(ends_V):
        count = max(1, round(abs(end - start) / step_V))
        voltages += [start + (end - start) * (k + 1) / count for k in range(count)]
    return voltages


def at(*voltages_V: float) -> float:
    return driven(FRESH, *voltages_V).displacement_um()


def test_the_recorded_branches_are_followed() -> None:
    top = driven(FRESH, *ramp(0.0, 2.5))
    assert top.displacement_um() == pytest.approx(52.0)
    assert at(1.0) == pytest.approx(-8.0 + 60.0 * 0.5**1.5, rel=0.02)
    down = driven(top, *ramp(2.5, 1.0))
    assert down.displacement_um() == pytest.approx(52.0 - 60.0 * 0.5**1.5, rel=0.02)


def test_after_a_reversal_the_arm_moves_towards_the_previous_reversal_point() -> None:
    inner = driven(FRESH, 2.5, 1.0)
    turned = inner.updated(1.3, 0.02)
    low_um = inner.displacement_um()
    share = (0.3 / 1.5) ** 1.5
    assert turned.displacement_um() == pytest.approx(low_um + (52.0 - low_um) * share, rel=0.01)


@pytest.mark.parametrize("beyond_V", [0.5, 2.7])
def test_a_hysteresis_loop_that_is_exceeded_is_forgotten(beyond_V: float) -> None:
    plain, looped = driven(FRESH, 2.5, 1.0), driven(FRESH, 2.5, 1.0, 1.8, 1.2, 1.6, 1.0)
    assert looped.displacement_um() == pytest.approx(plain.displacement_um())
    after = driven(looped, beyond_V)
    assert after.displacement_um() == pytest.approx(driven(plain, beyond_V).displacement_um())
    assert len(after.turns) == 2


@given(st.lists(st.floats(-1.0, 3.5), min_size=1, max_size=60))
def test_the_memory_is_bounded_and_the_arm_stays_on_its_branch(voltages: list[float]) -> None:
    response = FRESH
    for voltage in voltages:
        response = response.updated(voltage, 0.02)
        assert 2 <= len(response.turns) <= MOST_TURNS
        x_um = response.displacement_um()
        ends = sorted((response.turns[-1], response.turns[-2]), key=lambda turn: turn.voltage_V)
        # The ignored part of a reversal may lead beyond an end by this amount.
        slack_um = 40.0 * IGNORED_V
        assert ends[0].x_um - slack_um <= x_um <= ends[1].x_um + slack_um


@given(st.lists(st.floats(-1.0, 3.5), min_size=1, max_size=20), st.floats(-1.0, 3.5))
def test_the_displacement_is_continuous_except_for_ignored_small_reversals(
    voltages: list[float], end: float
) -> None:
    response = driven(FRESH, *voltages)
    for voltage in ramp(response.voltage_V, end, step_V=0.002):
        after = response.updated(voltage, 0.02)
        jump_um = abs(after.displacement_um() - response.displacement_um())
        assert jump_um < 200.0 * (IGNORED_V + 0.004)
        response = after


def test_a_spiral_forgets_only_its_smallest_loops() -> None:
    spiral = [1.0 + 1.4 * 0.93**k * (-1) ** k for k in range(40)]
    response = driven(FRESH, 2.5, -0.5, *spiral)
    assert MOST_TURNS - 1 <= len(response.turns) <= MOST_TURNS
    # The stored loops are the wide ones, and remain closed.
    assert driven(response, 2.5).displacement_um() == pytest.approx(52.0)


def test_the_noise_of_a_law_creates_no_loops() -> None:
    shaken = driven(FRESH, 2.5, 1.0, *[1.0 + 0.004 * (-1) ** k for k in range(100)])
    assert shaken.turns == driven(FRESH, 2.5, 1.0).turns


def test_beyond_the_record_the_response_is_straight_and_returns_on_a_branch() -> None:
    beyond = driven(FRESH, 3.0)
    assert beyond.displacement_um() == pytest.approx(52.0 + 20.0 * 0.5)
    back = driven(beyond, 1.25)
    assert back.turns[0] == BRANCHES.bottom
    assert back.displacement_um() == pytest.approx(62.0 - 70.0 * 0.5**1.5, rel=0.02)


def test_a_zero_changes_only_the_offset_and_the_error_grows_with_travel() -> None:
    arm = FRESH.updated(1.0, 0.02)
    samples = [arm.sample(40.0 + 0.01 * (index % 2)) for index in range(10)]
    zeroed = arm.rezero(samples, 10)
    assert zeroed.position_um() == pytest.approx(40.005)
    assert zeroed.turns == arm.turns
    assert zeroed.residual_um(samples[0]) == pytest.approx(-0.005)
    assert arm.begin(3.0).position_um() == pytest.approx(3.0)
    assert zeroed.error_um() == 0.0
    assert zeroed.updated(2.0, 0.02).error_um() == pytest.approx(0.2 * 2**0.5)


def test_the_tolerance_of_a_zero_is_five_errors_plus_the_creep() -> None:
    arm = FRESH.begin(0.0)
    assert arm.zero_tolerance_um(0.1) == 0.5
    assert arm.updated(1.0, 0.02).zero_tolerance_um(0.1) == pytest.approx(5 * 0.2 * 2**0.5 + 0.1)


def swings(*ends_V: float) -> Column:
    """Return smooth moves of 120 samples from one end to the next, and rests of 20."""
    parts: list[float] = []
    for start, end in pairwise(ends_V):
        parts += [start + (end - start) * 0.5 * (1 - cos(pi * k / 120)) for k in range(1, 121)]
        parts += [end] * 20
    return np.array(parts)


def test_branches_of_plays_are_computed_from_their_motion() -> None:
    voltage_V = swings(0.0, 2.5, -0.5, 2.5, -0.5, 1.5, 0.5, 2.0, -0.5, 2.5, 0.8, 1.6, 1.0, 2.5)
    x_um = simulate(MODEL, voltage_V, 0.02)
    noisy = x_um + np.random.default_rng(8).normal(0.0, 0.03, len(x_um))
    found = record_free_response(voltage_V.tolist(), noisy.tolist())
    assert found.branches.top.voltage_V == pytest.approx(2.5, abs=0.1)
    assert found.branches.bottom.voltage_V == pytest.approx(-0.5, abs=0.1)
    height_um = found.branches.top.x_um - found.branches.bottom.x_um
    assert height_um == pytest.approx(float(np.ptp(x_um)), rel=0.05)
    straight_um = float(np.std(x_um - np.polyval(np.polyfit(voltage_V, x_um, 1), voltage_V)))
    assert 0.02 < found.residual_um < 0.3 * straight_um


@pytest.mark.parametrize(
    ("voltage_V", "text"),
    [
        ([0.0] * 100, "75 samples of a voltage at rest"),
        (ramp(0.0, 2.0, 1.0, 1.5), r"no stroke down over the 1\.980 V"),
        (
            [0.0, *ramp(0.0, 2.0, 0.0, 2.0, 0.0, step_V=0.2)],
            "11 samples in a stroke up, 48 are needed",
        ),
        ([0.0, float("inf")], "not finite"),
    ],
)
def test_a_motion_without_branches_is_refused(voltage_V: list[float], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        record_free_response(voltage_V, [20.0 * u for u in voltage_V])


@pytest.mark.parametrize(
    ("bottom", "top", "shape", "text"),
    [
        (Turn(1.0, 0.0), Turn(0.0, 9.0), BENT, "voltage of the stroke = -1.0 V"),
        (Turn(0.0, 9.0), Turn(1.0, 0.0), BENT, "height of the stroke = -9.0 µm"),
        (Turn(0.0, 0.0), Turn(1.0, 9.0), (0.0, 0.5), "must go from 0 to 1"),
        (Turn(0.0, 0.0), Turn(1.0, 9.0), (0.0, 0.6, 0.5, 1.0), "rise of the ascending shape"),
    ],
)
def test_impossible_branches_are_refused(
    bottom: Turn, top: Turn, shape: tuple[float, ...], text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        RecordedBranches(bottom, top, shape, BENT)
