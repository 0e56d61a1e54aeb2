"""Learning across cycles: its equation, its bound, and its end."""

from math import cos, pi, sin

import pytest

from pincette.control.planning.repetition import (
    GAIN,
    MOST_CYCLES,
    MOST_UM,
    PATIENCE,
    Corrections,
    CycleLearner,
    cycle_ticks,
    no_corrections,
)

N = 20
DISTURBED = tuple(0.3 * sin(2.0 * pi * i / N) + 0.1 * cos(4.0 * pi * i / N) for i in range(N))


def test_a_cycle_is_corrected_by_the_weighted_errors_about_each_tick() -> None:
    begun, errors = no_corrections(4), (0.4, 0.0, -0.2, 0.0)
    learned = begun.improved(errors)
    expected = [-GAIN * value for value in (0.2, 0.05, -0.1, 0.05)]
    assert learned.values_um == pytest.approx(expected)
    assert learned.errors_um == pytest.approx((0.05**0.5,))


def test_what_repeats_is_learned_away_although_the_answer_comes_a_tick_late() -> None:
    learner = CycleLearner(no_corrections(N))
    for tick in range(MOST_CYCLES * N):
        late = learner.corrections.at(tick - 1)
        learner = learner.follow(tick, DISTURBED[tick % N] + late, limited=False)
    errors = learner.corrections.errors_um
    assert errors[-1] < 0.1 * errors[0]
    assert len(errors) == MOST_CYCLES
    assert learner.corrections.over
    assert learner.corrections.improved(DISTURBED) is learner.corrections


def test_a_correction_has_a_bound() -> None:
    known = no_corrections(4)
    for error_um in (8.0, 7.0, 6.0):
        known = known.improved((error_um,) * 4)
    assert known.values_um == (-MOST_UM,) * 4


def test_it_ends_where_no_error_falls_any_more() -> None:
    errors = (0.3, 0.1, *(0.12,) * PATIENCE)
    assert not Corrections((0.0,), errors[:-1]).over
    assert Corrections((0.0,), errors).over
    assert not Corrections((0.0,), (*errors[:-1], 0.09)).over


@pytest.mark.parametrize("fault", ["limited", "missing", "repeated"])
def test_a_cycle_that_is_not_whole_teaches_nothing(fault: str) -> None:
    learner = CycleLearner(no_corrections(4))
    ticks = {"limited": [0, 1, 2, 3], "missing": [0, 1, 3], "repeated": [0, 1, 1, 2, 3]}[fault]
    for tick in ticks:
        learner = learner.follow(tick, 0.5, limited=fault == "limited" and tick == 2)
    assert learner.corrections.errors_um == ()
    for tick in range(4, 8):
        learner = learner.follow(tick, 0.5, limited=False)
    assert learner.corrections.errors_um == (0.5,)


def test_a_cycle_is_a_whole_number_of_periods() -> None:
    assert cycle_ticks(0.2, 0.02) == 10
    with pytest.raises(ValueError, match=r"7 Hz: a cycle of 7\.143 control periods.*7\.14286 Hz"):
        cycle_ticks(1.0 / 7.0, 0.02)
    with pytest.raises(ValueError, match="5000 ticks, at most 2000"):
        cycle_ticks(100.0, 0.02)
