"""The linear free response and its re-zeroing just before contact."""

import pytest

from pincette.control.response.free_response import (
    FreeSample,
    free_position,
    nominal_response,
)

MODEL = nominal_response(19.0, FreeSample(0.0, 2.0))


def ramp(from_V: float, to_V: float, from_um: float, slope: float) -> list[FreeSample]:
    """Return fifty samples of a straight branch."""
    steps = [(to_V - from_V) * index / 50 for index in range(51)]
    return [FreeSample(from_V + step_V, from_um + slope * step_V) for step_V in steps]


def rest(after: list[FreeSample], count: int = 8) -> list[FreeSample]:
    return [*after, *[after[-1]] * count]


def test_the_free_position_follows_the_nominal_line() -> None:
    assert free_position(MODEL, 0.0) == 2.0
    assert free_position(MODEL, 1.5) == pytest.approx(2.0 + 28.5)


def test_a_zero_sets_the_line_through_the_rest_position_with_the_slope_of_the_branch() -> None:
    model = MODEL.rezero(rest(ramp(0.0, 1.2, 2.0, 22.0)), 8)
    assert model.gain_um_per_V == pytest.approx(22.0)
    assert free_position(model, 1.2) == pytest.approx(2.0 + 26.4)
    assert free_position(model, 1.7) == pytest.approx(2.0 + 37.4)
    assert model.nominal_um_per_V == 19.0


def test_the_slope_of_the_line_is_that_at_the_end_of_a_bent_branch() -> None:
    bent = ramp(0.0, 0.9, 0.0, 16.0)
    bent += ramp(0.9, 1.2, bent[-1].x_um, 21.0)
    assert MODEL.rezero(rest(bent), 8).gain_um_per_V == pytest.approx(21.0)


def test_sensor_noise_averages_out() -> None:
    samples = rest(ramp(0.0, 1.2, 0.0, 20.0), count=20)
    noisy = [
        FreeSample(sample.voltage_V, sample.x_um + (0.03 if index % 2 else -0.03))
        for index, sample in enumerate(samples)
    ]
    assert MODEL.rezero(noisy, 20).gain_um_per_V == pytest.approx(20.0, rel=0.01)


def test_only_the_branch_after_a_reversal_determines_the_slope() -> None:
    up = ramp(0.0, 1.0, 0.0, 20.0)
    down = ramp(1.0, 0.85, up[-1].x_um, 14.0)
    model = MODEL.rezero(rest([*up, *down]), 8)
    assert model.gain_um_per_V == pytest.approx(14.0, rel=0.01)


@pytest.mark.parametrize("slope", [19.0 * 1.5, 19.0 * 0.5, -19.0])
def test_an_implausible_slope_is_replaced_by_the_nominal_one(slope: float) -> None:
    model = MODEL.rezero(rest(ramp(0.0, 1.0, 0.0, slope)), 8)
    assert model.gain_um_per_V == 19.0
    assert free_position(model, 1.0) == pytest.approx(slope)


def test_with_too_little_travel_the_nominal_slope_is_kept() -> None:
    before = MODEL.rezero(rest(ramp(0.0, 1.0, 0.0, 22.0)), 8)
    model = before.rezero(rest(ramp(1.0, 1.09, 5.0, 24.0)), 8)
    assert model.gain_um_per_V == 19.0
    assert free_position(model, 1.09) == pytest.approx(5.0 + 24.0 * 0.09)


@pytest.mark.parametrize("rest_samples", [0, 3])
def test_a_zero_with_too_few_samples_at_rest_is_refused(rest_samples: int) -> None:
    with pytest.raises(ValueError, match=f"2 samples, must be at least {rest_samples} at rest"):
        MODEL.rezero([FreeSample(0.0, 0.0)] * 2, rest_samples)


def test_the_tolerance_of_a_zero_grows_with_travel_and_creep() -> None:
    zeroed = MODEL.updated(1.0, 0.02).begin(3.0)
    assert zeroed.zero_tolerance_um(0.0) == 5.0
    moved = zeroed.updated(0.5, 0.02)
    assert moved.zero_tolerance_um(0.3) == pytest.approx(5.0 + 0.4 * 19.0 * 0.5 + 0.3)


def test_a_new_arming_keeps_the_uncertainty_from_the_furthest_travel() -> None:
    line = nominal_response(19.0, FreeSample(0.0, 0.0), hysteresis_fraction=0.2)
    returned = line.updated(2.5, 0.02).updated(0.0, 0.02).begin(25.7)
    assert returned.position_um() == 25.7
    assert returned.error_um() == pytest.approx(0.2 * 19.0 * 2.5)
    zeroed = returned.rezero([FreeSample(0.0, 25.7)] * 8, 8)
    assert zeroed.error_um() == 0.0
