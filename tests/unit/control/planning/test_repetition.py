"""Learning across cycles: its equation, its bound, and its end."""

from collections.abc import Callable
from math import cos, pi, sin, sqrt
from random import Random

import pytest

from pincette.control.planning.repetition import (
    GAIN,
    MOST_CYCLES,
    MOST_UM,
    PATIENCE,
    Corrections,
    CycleLearner,
    HeldOut,
    cycle_ticks,
    held_out,
    no_corrections,
)

N = 20
DISTURBED = tuple(0.3 * sin(2.0 * pi * i / N) + 0.1 * cos(4.0 * pi * i / N) for i in range(N))


def test_the_correction_of_a_tick_is_a_weighted_sum_of_the_errors_around_it() -> None:
    begun, errors = no_corrections(4), (0.4, 0.0, -0.2, 0.0)
    learned = begun.improved(errors)
    expected = [-GAIN * value for value in (0.2, 0.05, -0.1, 0.05)]
    assert learned.values_um == pytest.approx(expected)
    assert learned.errors_um == pytest.approx((0.05**0.5,))


def test_repeating_errors_are_learned_even_if_the_response_is_one_tick_late() -> None:
    learner = CycleLearner(no_corrections(N))
    for tick in range(MOST_CYCLES * N):
        late = learner.corrections.at(tick - 1)
        learner = learner.updated(tick, DISTURBED[tick % N] + late, limited=False)
    errors = learner.corrections.errors_um
    assert errors[-1] < 0.1 * errors[0]
    assert len(errors) == MOST_CYCLES
    assert learner.corrections.over
    assert learner.corrections.improved(DISTURBED) is learner.corrections


def test_a_correction_is_bounded() -> None:
    known = no_corrections(4)
    for error_um in (8.0, 7.0, 6.0):
        known = known.improved((error_um,) * 4)
    assert known.values_um == (-MOST_UM,) * 4


def followed(learner: CycleLearner, cycles: int, noise: Callable[[], float]) -> CycleLearner:
    """Return cycles whose error is the unlearned rest of ``DISTURBED``, and noise."""
    for tick in range(cycles * N):
        error_um = DISTURBED[tick % N] + learner.corrections.at(tick) + noise()
        learner = learner.updated(tick, error_um, limited=False)
    return learner


@pytest.mark.parametrize("seed", range(8))
def test_learning_ends_without_repeating_errors_and_keeps_the_best_corrections(seed: int) -> None:
    chance = Random(seed)
    found = followed(CycleLearner(no_corrections(N)), 20, lambda: chance.gauss(0.0, 0.05))
    known = found.corrections
    print(f"seed {seed}: {[f'{error:.3f}' for error in known.errors_um]} µm")
    assert known.over
    assert 4 <= len(known.errors_um) <= MOST_CYCLES
    # The correction of the best cycle is kept, and leaves little repeating error beyond the noise.
    assert known.values_um == known.best_um
    left = [a + b for a, b in zip(DISTURBED, known.values_um, strict=True)]
    assert sum(value * value for value in left) / N < 0.05**2
    assert min(known.errors_um) < 0.4 * known.errors_um[0]


@pytest.mark.parametrize("seed", range(8))
def test_corrections_learned_from_noise_are_small(seed: int) -> None:
    chance, learner = Random(seed), CycleLearner(no_corrections(100))
    for tick in range(MOST_CYCLES * 100):
        error_um = learner.corrections.at(tick) + chance.gauss(0.0, 0.04)
        learner = learner.updated(tick, error_um, limited=False)
    known = learner.corrections
    assert known.over
    assert len(known.errors_um) <= 6
    mean_square = sum(value * value for value in known.values_um) / 100
    # The error is less than a tenth larger than without.
    assert mean_square < 0.2 * 0.04**2


def test_finished_corrections_do_not_change() -> None:
    best = Corrections((0.2,), (0.3, 0.1, 0.12, 0.13), (0.2,), PATIENCE)
    assert best.over
    assert best.improved((0.5,), (0.5,)) is best


def test_a_gap_between_cycles_does_not_end_learning() -> None:
    learner = CycleLearner(no_corrections(4))
    for tick in range(4):
        learner = learner.updated(tick, 0.5, limited=False)
    learner = learner.updated(4, 0.5, limited=True)
    for tick in range(8, 12):
        learner = learner.updated(tick, -0.5, limited=False)
    assert learner.corrections.quiet == 0
    assert len(learner.corrections.errors_um) == 2


@pytest.mark.parametrize("fault", ["limited", "missing", "repeated"])
def test_an_incomplete_cycle_is_not_used_for_learning(fault: str) -> None:
    learner = CycleLearner(no_corrections(4))
    ticks = {"limited": [0, 1, 2, 3], "missing": [0, 1, 3], "repeated": [0, 1, 1, 2, 3]}[fault]
    for tick in ticks:
        learner = learner.updated(tick, 0.5, limited=fault == "limited" and tick == 2)
    assert learner.corrections.errors_um == ()
    for tick in range(4, 8):
        learner = learner.updated(tick, 0.5, limited=False)
    assert learner.corrections.errors_um == (0.5,)


def test_a_cycle_is_a_whole_number_of_periods() -> None:
    assert cycle_ticks(0.2, 0.02) == 10
    with pytest.raises(ValueError, match=r"7 Hz: a cycle of 7\.143 control periods.*7\.14286 Hz"):
        cycle_ticks(1.0 / 7.0, 0.02)
    with pytest.raises(ValueError, match="5000 ticks, at most 2000"):
        cycle_ticks(100.0, 0.02)


NOISE_UM = 0.03


def judged(
    seed: int, cycles: int, *, share: float, drift_um: float = 0.0, noise_um: float = NOISE_UM
) -> HeldOut | None:
    """Learn over some cycles, and judge them by what they were not learned from.

    Parameters
    ----------
    share
        Size of what repeats, over ``DISTURBED``.
    drift_um
        Growth of the error from one cycle to the next.
    """
    draw, learner, errors_um = Random(seed), CycleLearner(no_corrections(N)), list[float]()
    for cycle in range(cycles):
        squares = 0.0
        for tick in range(N):
            error_um = share * DISTURBED[tick] + learner.corrections.at(tick)
            error_um += draw.gauss(0.0, noise_um) + drift_um * cycle
            squares += error_um**2
            learner = learner.updated(tick, error_um, limited=False)
        errors_um.append(sqrt(squares / N))
    return held_out(errors_um[0], errors_um[1:], ticks=N, noise_um=noise_um)


def share_kept(cycles: int, **case: float) -> float:
    found = [judged(seed, cycles, **case) for seed in range(200)]  # pyright: ignore[reportArgumentType]
    return sum(one is not None and one.helps for one in found) / len(found)


@pytest.mark.parametrize("cycles", [2, 3, 6, 12])
def test_corrections_learned_from_noise_are_not_stored(cycles: int) -> None:
    assert share_kept(cycles, share=0.0) < 0.05


@pytest.mark.parametrize("cycles", [2, 3, 6, 12])
def test_repeating_errors_are_stored_even_after_few_cycles(cycles: int) -> None:
    assert share_kept(cycles, share=1.0) == 1.0


def test_corrections_of_a_single_cycle_are_not_stored() -> None:
    assert judged(1, 1, share=1.0) is None


def test_corrections_made_worse_by_a_drift_are_not_stored() -> None:
    assert share_kept(6, share=0.2, drift_um=0.1) == 0.0


def test_corrections_at_the_noise_level_are_stored_only_if_they_help() -> None:
    """The figures are those of the cycles, whatever the decision."""
    for seed in range(50):
        found = judged(seed, 6, share=0.15, noise_um=0.06)
        assert found is not None
        assert not found.helps or found.after_um < found.before_um
