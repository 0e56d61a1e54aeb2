import math
from itertools import pairwise

import pytest

from pincette.sim.plant.noise import BLOCK, GaussianNoise


def test_the_noise_has_the_specified_mean_and_variance_and_no_correlation() -> None:
    noise = GaussianNoise(1)
    values = [noise.at(index) for index in range(20_000)]
    mean = math.fsum(values) / len(values)
    variance = math.fsum((value - mean) ** 2 for value in values) / len(values)
    neighbours = math.fsum(a * b for a, b in pairwise(values)) / len(values)
    assert mean == pytest.approx(0.0, abs=0.03)
    assert variance == pytest.approx(1.0, abs=0.04)
    assert neighbours == pytest.approx(0.0, abs=0.03)


def test_a_number_depends_on_seed_and_index_only() -> None:
    requested, again = GaussianNoise(7), GaussianNoise(7)
    places = [0, 5 * BLOCK, 3, BLOCK - 1, BLOCK, 3]
    assert [requested.at(index) for index in places] == [
        GaussianNoise(7).at(index) for index in places
    ]
    assert again.at(3) == requested.at(3)
    assert GaussianNoise(8).at(3) != requested.at(3)
    assert requested.at(3) != requested.at(BLOCK + 3)


def test_each_stream_has_independent_noise() -> None:
    count = 5000
    first, other = GaussianNoise(1), GaussianNoise(1, stream=1)
    pairs = [(first.at(index), other.at(index)) for index in range(count)]
    alike = math.fsum(a * b for a, b in pairs) / count
    shifted = math.fsum(a * b for (a, _), (_, b) in pairwise(pairs)) / count
    assert alike == pytest.approx(0.0, abs=0.05)
    assert shifted == pytest.approx(0.0, abs=0.05)
    assert GaussianNoise(1, stream=0).at(7) == first.at(7)
