"""The identified free response: its memory, its zero and its stated error."""

import pytest

from pincette.control.response.free_response import FreeSample
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.identified_response import identified_response

MODEL = HysteresisModel((0.0, 0.5), (10.0, 5.0), (1.0,), (0.1,))
FRESH = identified_response(MODEL, 19.0, 0.2)


def test_a_zero_changes_only_the_offset() -> None:
    arm = FRESH.updated(1.0, 0.02)
    samples = [arm.sample(40.0 + 0.01 * (index % 2)) for index in range(10)]
    zeroed = arm.rezero(samples, 10)
    assert zeroed.position_um() == pytest.approx(40.005)
    assert zeroed.memory == arm.memory
    rise_um = zeroed.updated(1.5, 0.02).position_um() - zeroed.position_um()
    assert rise_um == pytest.approx(arm.updated(1.5, 0.02).position_um() - arm.position_um())


def test_residuals_of_earlier_samples_are_computed_with_the_present_offset() -> None:
    arm = FRESH.updated(1.0, 0.02)
    sample = arm.sample(3.0)
    later = arm.begin(7.0).updated(2.0, 0.02)
    assert later.residual_um(sample) == pytest.approx(-4.0)


def test_a_new_arming_keeps_the_memory() -> None:
    pressed = FRESH.updated(2.0, 0.02).updated(1.0, 0.02)
    begun = pressed.begin(5.0)
    assert begun.position_um() == pytest.approx(5.0)
    assert begun.memory == pressed.memory
    assert begun.zero_V == 1.0


def test_the_error_grows_with_travel_up_to_a_limit() -> None:
    begun = FRESH.updated(1.0, 0.02).begin(0.0)
    errors = [begun.updated(1.0 + travel, 0.02).error_um() for travel in (0.0, 0.25, 0.5, 1.5)]
    assert errors == pytest.approx([0.0, 0.2 * 2**0.5 / 2, 0.2 * 2**0.5, 0.2 * 2**0.5])


def test_a_zero_with_too_few_samples_at_rest_is_refused() -> None:
    with pytest.raises(ValueError, match="1 samples, must be at least 10 at rest"):
        FRESH.rezero([FreeSample(0.0, 0.0)], 10)


def test_the_tolerance_of_a_zero_is_five_errors_plus_the_creep() -> None:
    begun = FRESH.updated(1.0, 0.02).begin(0.0)
    assert begun.zero_tolerance_um(0.1) == 0.5
    moved = begun.updated(2.0, 0.02)
    assert moved.zero_tolerance_um(0.1) == pytest.approx(5 * 0.2 * 2**0.5 + 0.1)
