"""The kink that a contact causes, and motions without one."""

from math import sin
from random import Random

import pytest

from pincette.control.force.contact_detector import ContactDetector, KinkLimits, kink_limits

S_P, K_E, NOISE_UM = 0.46, 2.17, 0.03
LIMITS = kink_limits(0.7 * K_E, S_P, NOISE_UM)


def closed(
    x_to_um: float,
    *,
    contact_um: float = 1e9,
    K_e: float = K_E,
    bend: float = 0.0,
    seed: int = 1,
) -> ContactDetector:
    """Return a detector after d_p·u went from 0 to ``x_to_um`` in steps of 0.3 µm.

    The free arm moves by a share of 1 - bend of the first step and 1 + bend of the last, as on a
    branch of a hysteresis loop; a negative bend is that of an arm that saturates.
    """
    chance = Random(seed)
    watch = ContactDetector(0.0, 3.0)
    count = round(x_to_um / 0.3)
    arm_um = 0.0
    for index in range(1, count + 1):
        arm_um += 0.3 * (1.0 + bend * (2.0 * index / count - 1.0))
        pressed_um = max(0.0, arm_um - contact_um) * S_P * K_e / (1.0 + S_P * K_e)
        x_um = 3.0 + arm_um - pressed_um + chance.gauss(0.0, NOISE_UM)
        watch = watch.updated(LIMITS, x_um, 0.3 * index)
    return watch


@pytest.mark.parametrize("K_e", [0.7 * K_E, K_E, 1.3 * K_E])
@pytest.mark.parametrize("contact_um", [8.0, 8.5, 9.0, 9.5, 10.0])
def test_a_contact_is_detected_where_it_begins(contact_um: float, K_e: float) -> None:
    touch = closed(18.0, contact_um=contact_um, K_e=K_e, bend=0.3).touch
    assert touch is not None
    assert touch.x_um == pytest.approx(3.0 + contact_um, abs=LIMITS.step_um)
    # From there on a further 5 µm of free motion would be pushed back by 5 µm times the drop.
    back_um = touch.pushed_back_um(touch.x_um + 2.0, touch.nominal_um + 5.0)
    assert back_um == pytest.approx(5.0 * touch.slope - 2.0)
    assert touch.slope == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("bend", [0.0, 0.3, -0.3])
def test_noise_on_a_free_branch_is_not_detected_as_a_touch(bend: float) -> None:
    assert all(closed(60.0, bend=bend, seed=seed).touch is None for seed in range(40))


def test_a_touch_is_cleared_if_the_arm_opens_far_beyond_its_position() -> None:
    watch = closed(18.0, contact_um=12.0)
    touch = watch.touch
    assert touch is not None
    back = watch.updated(LIMITS, 16.0, 14.5)
    assert back.touch == touch
    assert back.updated(LIMITS, 12.0, 9.0).touch is None


def test_a_reversal_starts_a_new_branch() -> None:
    watch = ContactDetector(0.0, 0.0)
    for index in range(1, 11):
        watch = watch.updated(LIMITS, 2.0 * index, 2.0 * index)
    for index in range(9, 4, -1):
        watch = watch.updated(LIMITS, 2.0 * index, 2.0 * index)
    # Half the slope it had before the reversal.
    for index in range(6, 12):
        watch = watch.updated(LIMITS, 10.0 + 1.0 * (index - 5), 2.0 * index)
    assert watch.touch is None


def test_a_reversal_by_less_than_a_step_keeps_the_branch_and_its_touch() -> None:
    watch = closed(18.0, contact_um=12.0)
    begin_um = watch.nominal_um
    back_um = 0.9 * LIMITS.step_um * abs(sin(1.0))
    back = watch.updated(LIMITS, 15.0, 18.0 - back_um)
    assert (back.nominal_um, back.touch) == (begin_um, watch.touch)
    assert watch.updated(LIMITS, 12.0, 18.0 - 1.1 * LIMITS.step_um).nominal_um > begin_um


@pytest.mark.parametrize("noise_um", [0.02, 0.05, 0.1, 0.15])
@pytest.mark.parametrize("gain", [0.5, 0.85, 1.1])
@pytest.mark.parametrize("K_e", [0.75 * K_E, 1.25 * K_E])
def test_a_part_is_found_below_six_millinewtons_also_with_a_noisy_sensor(
    K_e: float, gain: float, noise_um: float
) -> None:
    """This also holds for an arm that moves by half of d_p, as in a wide loop after a reversal."""
    limits, chance = kink_limits(0.7 * K_E, S_P, noise_um), Random(11)
    watch, arm_um, force_mN, found_mN = ContactDetector(0.0, 0.0), 0.0, 0.0, 0.0
    for index in range(1, 400):
        arm_um += 0.3 * gain
        pressed_um = max(0.0, arm_um - 20.0) * S_P * K_e / (1.0 + S_P * K_e)
        force_mN = pressed_um / S_P
        x_um = arm_um - pressed_um + chance.gauss(0.0, noise_um)
        watch = watch.updated(limits, x_um, 0.3 * index)
        if watch.touch is not None:
            found_mN = watch.touch.pushed_back_um(x_um, 0.3 * index) / S_P
        if found_mN >= 2.0:
            break
    print(K_e, gain, noise_um, force_mN, found_mN)
    assert 0.5 < force_mN < 6.0
    assert found_mN >= 2.0


@pytest.mark.parametrize("noise_um", [0.02, 0.034])
def test_the_saturation_of_a_free_arm_is_not_detected_as_a_touch(noise_um: float) -> None:
    """Like relays of a loop of 39 % above 2 V: the slope falls from 1.65 to 1.15 in 12 µm."""
    limits, watch, arm_um = kink_limits(0.7 * K_E, S_P, noise_um), ContactDetector(0.0, 0.0), 0.0
    chance = Random(3)
    for index in range(1, 180):
        nominal_um = 0.3 * index
        arm_um += 0.3 * (1.65 - 0.5 * min(1.0, max(0.0, (nominal_um - 35.0) / 12.0)))
        watch = watch.updated(limits, arm_um + chance.gauss(0.0, noise_um), nominal_um)
        assert watch.touch is None, nominal_um


def test_a_touch_is_cleared_when_a_later_bend_compensates_it() -> None:
    watch = closed(14.0, contact_um=12.0)
    assert watch.touch is not None
    slope = watch.touch.slope
    for index in range(1, 21):
        nominal_um = 14.0 + 0.3 * index
        x_um = watch.touch.x_um + slope * (nominal_um - watch.touch.nominal_um)
        watch = watch.updated(LIMITS, x_um, nominal_um)
        if watch.touch is None:
            break
    assert watch.touch is None


def test_a_noisy_sensor_or_a_soft_part_needs_a_longer_step() -> None:
    assert kink_limits(2.0, S_P, 0.0) == KinkLimits(1.0, 0.5 * 0.92 / 1.92, 0.0)
    assert kink_limits(2.0, S_P, 0.1).step_um > 3.0
    assert kink_limits(0.2, S_P, 0.03).step_um > 5.0
    with pytest.raises(ValueError, match=r"softest contact = 0.0 mN/µm"):
        kink_limits(0.0, S_P, 0.03)


def test_an_arm_that_still_moves_back_after_a_reversal_is_not_detected_as_a_touch() -> None:
    watch = ContactDetector(0.0, 0.0, free_to_um=0.0)
    watch = watch.updated(LIMITS, -2.0, 2.0)
    assert watch.touch is None


def test_a_kink_at_positions_reached_before_does_not_hide_a_touch_further_on() -> None:
    """A bend far behind the furthest position hid a part, which the arm then pressed with 54 mN."""
    step_um = 1.01 * LIMITS.step_um
    watch = ContactDetector(0.0, 0.0, free_to_um=20.0)
    nominal_um = x_um = 0.0
    for slope in (1.0, 0.4, *[1.0] * 20, *[0.5] * 5):
        nominal_um, x_um = nominal_um + step_um, x_um + slope * step_um
        watch = watch.updated(LIMITS, x_um, nominal_um)
    assert watch.touch is not None
    assert watch.touch.on_new_ground
    assert watch.touch.x_um == pytest.approx(x_um - 2.5 * step_um, abs=1.1 * step_um)
