"""Conditions under which a zero is refused, and the figures of the refusal."""

from random import Random

import pytest

from pincette.control.faults import FaultCode
from pincette.control.force.contact_detector import DetectedContact
from pincette.control.force.zeroing import ZeroLimits, zero_refusal
from pincette.control.response.free_response import FreeSample, nominal_response
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.identified_response import identified_response
from pincette.core.wording import fault_text

D_P = 19.0
MODEL = nominal_response(D_P, FreeSample(0.0, 0.0))
LIMITS = ZeroLimits(
    rest_samples=5,
    spread_um=0.5,
    first_touch_um=27.0,
    touch_um=0.92,
)


def refusal(
    positions_um: list[float],
    voltage_V: float = 0.0,
    *,
    part_held: bool = False,
    creep_um: float = 0.0,
    touch: DetectedContact | None = None,
    zeroed: bool = True,
) -> str:
    samples = [FreeSample(voltage_V, x_um) for x_um in positions_um]
    found = zero_refusal(
        MODEL.updated(voltage_V, 0.02),
        samples,
        part_held=part_held,
        limits=LIMITS,
        creep_um=creep_um,
        touch=touch,
        zeroed=zeroed,
    )
    return fault_text(found)


def test_zero_of_a_settled_free_arm_is_allowed() -> None:
    assert refusal([40.0, 20.0, 0.1, 0.0, 0.2, -0.1, 0.0]) == ""


def test_zero_is_refused_while_a_part_is_held() -> None:
    assert "a part is held" in refusal([0.0] * 5, part_held=True)


def test_zero_is_refused_without_enough_rest() -> None:
    assert "4 samples of rest, must be 5" in refusal([0.0] * 4)


def test_zero_is_refused_while_the_arm_moves() -> None:
    text = refusal([0.0, 0.2, 0.4, 0.6, 0.8])
    assert "0.800 µm" in text
    assert "limit 0.5 µm" in text


def test_zero_is_refused_while_the_arm_is_blocked() -> None:
    samples = [FreeSample(0.01 * index, 0.0) for index in range(5)]
    text = fault_text(zero_refusal(MODEL, samples, part_held=False, limits=LIMITS))
    assert "moved by 0.760 µm" in text


def test_zero_is_refused_if_the_offset_is_implausible() -> None:
    assert "change by 6.000 µm, limit 5.000 µm" in refusal([6.0] * 5)
    assert refusal([4.0] * 5) == ""
    # One volt of travel allows for 40 % of 19 µm.
    assert refusal([19.0 + 7.5] * 5, voltage_V=1.0) == ""
    assert "-13.000 µm, limit 12.600 µm after 19.0 µm" in refusal([19.0 - 13.0] * 5, voltage_V=1.0)


def test_possible_creep_widens_the_limit_of_the_offset() -> None:
    assert refusal([-6.0] * 5, creep_um=1.1) == ""
    assert "limit 6.100 µm" in refusal([-6.2] * 5, creep_um=1.1)


@pytest.mark.parametrize("known", [True, False])
def test_a_better_model_tolerates_a_smaller_offset_unless_its_memory_is_unknown(
    known: bool,
) -> None:
    model = identified_response(HysteresisModel((0.0,), (D_P,)), D_P, 0.1).updated(1.0, 0.02)
    samples = [model.sample(D_P - 3.0)] * 5
    assert model.zero_tolerance_um(0.0) < 1.0
    found = zero_refusal(model, samples, part_held=False, limits=LIMITS, memory_known=known)
    text = fault_text(found)
    assert ("the offset would change by -3.000 µm" in text) == known
    assert (text == "") == (not known)


def test_before_the_first_zero_the_refusal_states_what_to_do() -> None:
    assert "arm again" in refusal([6.0] * 5, zeroed=False)
    assert "arm again" not in refusal([6.0] * 5, zeroed=True)


def test_zero_is_refused_if_the_arm_rests_so_near_to_the_part_that_it_may_touch_it() -> None:
    assert refusal([26.9] * 5, voltage_V=1.42) == ""
    text = refusal([27.1] * 5, voltage_V=1.42)
    assert "rests at 27.100 µm" in text
    assert "limit 27.000 µm" in text


def test_a_zero_is_refused_if_the_arm_was_pushed_back_since_a_touch() -> None:
    touch = DetectedContact(x_um=12.0, nominal_um=15.0, slope=0.75)
    text = refusal([14.0] * 5, voltage_V=1.0, touch=touch)
    assert "touched something at 12.000 µm" in text
    assert "by 1.000 µm since, limit 0.920 µm" in text
    # Within the limit only the noise of the kink counts, not the offset of the model.
    assert refusal([14.1] * 5, voltage_V=1.0, touch=touch) == ""


def test_a_reading_that_is_not_a_number_is_refused() -> None:
    assert refusal([0.0, 0.0, float("nan"), 0.0, 0.0]) != ""


@pytest.mark.parametrize("spread_um", [0.4, 0.6])
def test_readings_are_refused_only_by_their_spread(spread_um: float) -> None:
    assert (refusal([0.0, 0.0, spread_um, 0.0, 0.0]) == "") == (spread_um < 0.5)


@pytest.mark.parametrize("noise_um", [0.05, 0.15, 0.4])
def test_noise_alone_never_refuses_a_zero(noise_um: float) -> None:
    """A fixed 0.5 µm for every sensor refused 37 % of the zeros at a noise of 0.15 µm."""
    chance, limits = Random(7), ZeroLimits(rest_samples=10, noise_um=noise_um)
    refused = 0
    for _ in range(2000):
        rest = [FreeSample(0.0, chance.gauss(0.0, noise_um)) for _ in range(10)]
        refused += zero_refusal(MODEL, rest, part_held=False, limits=limits) is not None
    assert refused == 0


def test_an_arm_that_moves_by_more_than_its_noise_is_not_settled() -> None:
    limits = ZeroLimits(rest_samples=10, noise_um=0.15)
    glides = [FreeSample(0.0, 0.16 * index) for index in range(10)]
    found = zero_refusal(MODEL, glides, part_held=False, limits=limits)
    assert found is not None
    assert found.code is FaultCode.ZERO_NOT_SETTLED
    assert found.number("limit_um") == pytest.approx(1.2, abs=0.1)
