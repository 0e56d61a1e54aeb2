"""Random pairs of arms, each arm calibrated alone, driven by the services: one of each class."""

from pathlib import Path

import pytest

from pincette_study.beyond.tracks import CLASSES
from pincette_study.two_arms.acceptance import FIGURES, run_pair
from tests.support.two_arms import TWO_ARMS


@pytest.mark.parametrize("hysteresis", list(CLASSES))
def test_a_random_pair_stays_within_the_worst_value_of_each_figure(
    hysteresis: str, tmp_path: Path
) -> None:
    found = run_pair(TWO_ARMS, tmp_path, (hysteresis, 0))
    reached = {each.name: value for each, value in zip(FIGURES, found.values, strict=True)}
    assert all(reached[each.name] <= each.worst for each in FIGURES), reached
