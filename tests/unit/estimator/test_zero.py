"""A zero is taken only if the arm is free: contacts during the motion, positions beyond the
first contact."""

import pytest

from pincette.config import IdentifiedFreeResponse
from pincette.core.faults import Mode
from pincette.core.messages import Estimate
from pincette.core.wording import fault_text
from pincette_estimator.config import configure
from tests.unit.estimator.bench import TAUGHT, Bench, a_rig

S_P, K_E = 0.46, 2.17
RESPONSES = pytest.mark.parametrize("taught", [None, TAUGHT], ids=["linear", "identified"])


class Approach:
    """A bench whose arm closes, free or onto something."""

    def __init__(self, taught: IdentifiedFreeResponse | None) -> None:
        self.bench = Bench(configure(a_rig(taught)))
        self.bench.rest(0.0, 0.0)
        self.voltage_V = 0.0

    def close_to(self, x_to_um: float, contact_um: float = 1e9, ticks: int = 100) -> None:
        """Raise the voltage until the arm has reached ``x_to_um``, or as far as the voltage
        allows."""
        while self.place(contact_um) < x_to_um and ticks:
            self.voltage_V += 0.02
            self.feed(contact_um)
            ticks -= 1

    def place(self, contact_um: float) -> float:
        """Set the arm's position: a constant behind the model's x_1, and pressed back."""
        free_um = self.bench.state.arms[0].response.updated(self.voltage_V, 0.02).position_um()
        pressed_um = max(0.0, free_um - contact_um) * S_P * K_E / (1.0 + S_P * K_E)
        return free_um - pressed_um

    def feed(self, contact_um: float, *, zero: bool = False) -> Estimate:
        return self.bench.feed(self.place(contact_um), self.voltage_V, zero=zero)

    def zero(self, contact_um: float = 1e9) -> Estimate:
        for _ in range(12):
            self.feed(contact_um)
        return self.feed(contact_um, zero=True)


@RESPONSES
def test_a_free_arm_may_be_zeroed_only_before_the_first_touch(
    taught: IdentifiedFreeResponse | None,
) -> None:
    approach = Approach(taught)
    approach.close_to(20.0)
    assert approach.zero().arms[0].zero_refusal is None
    approach.close_to(28.0)
    assert "it may touch the part, limit 27.000 µm" in fault_text(
        approach.zero().arms[0].zero_refusal
    )


@RESPONSES
def test_an_arm_that_touched_something_is_not_zeroed(
    taught: IdentifiedFreeResponse | None,
) -> None:
    approach = Approach(taught)
    assert approach.zero().arms[0].zero_refusal is None
    approach.close_to(16.0, contact_um=12.0)
    before = approach.zero(12.0)
    assert before.arms[0].force_mN > 2.0
    assert "touched something at 1" in fault_text(before.arms[0].zero_refusal)
    # At its start position it is free again.
    approach.voltage_V = 0.0
    assert approach.zero(12.0).arms[0].zero_refusal is None


def test_before_the_first_zero_the_refusal_states_what_to_do() -> None:
    approach = Approach(None)
    approach.bench.rest(-7.0, 0.0)
    estimate = approach.bench.feed(-7.0, 0.0, zero=True)
    assert "the offset would change by -7.000 µm" in fault_text(estimate.arms[0].zero_refusal)
    assert "open the gripper, and arm again" in fault_text(estimate.arms[0].zero_refusal)
    assert estimate.arms[0].zero_age_s is None


def test_the_first_zero_of_an_estimator_allows_an_offset_from_its_unknown_history() -> None:
    approach = Approach(TAUGHT)
    assert approach.zero().arms[0].zero_refusal is None

    def short_of_the_model(by_um: float) -> str:
        """Rest this far short of x_1 and request a zero there."""
        refusal = ""
        for count in range(13):
            response = approach.bench.state.arms[0].response
            x_um = response.updated(approach.voltage_V, 0.02).position_um() - by_um
            estimate = approach.bench.feed(x_um, approach.voltage_V, zero=count == 12)
            refusal = fault_text(estimate.arms[0].zero_refusal)
        return refusal

    approach.close_to(15.0)
    assert short_of_the_model(3.0) == ""
    approach.bench.arm(2)
    approach.bench.feed(15.0, approach.voltage_V)
    approach.voltage_V -= 0.5
    assert "the offset would change by -3.0" in short_of_the_model(3.0)


LOST_UM = 1e6
"""Reading that no arm can have, so it counts as not measured."""


def with_a_zero_due(lost: int = 1) -> Approach:
    """Return a rest in which the sample of a zero, and those after it, were not measured."""
    approach = Approach(None)
    approach.close_to(10.0)
    approach.zero()
    approach.close_to(15.0)
    for _ in range(12):
        approach.feed(1e9)
    for number in range(lost):
        first = number == 0
        found = approach.bench.feed(LOST_UM, approach.voltage_V, zero=first, answered=first)
        assert not found.valid
    return approach


@pytest.mark.parametrize("lost", [1, 3])
def test_a_zero_whose_sample_is_lost_is_taken_once_at_the_next_measured_sample(lost: int) -> None:
    approach = with_a_zero_due(lost)
    place_um, voltage_V = approach.place(1e9), approach.voltage_V
    taken = approach.bench.feed(place_um, voltage_V, answered=False)
    assert (taken.valid, taken.arms[0].zero_age_s) == (True, 0.0)
    after = approach.bench.feed(place_um, voltage_V, answered=False)
    assert after.arms[0].zero_age_s == pytest.approx(0.02)


def test_a_zero_whose_sample_is_lost_may_be_refused_at_the_next_measured_sample() -> None:
    approach = with_a_zero_due()
    found = approach.bench.feed(0.0, approach.voltage_V, answered=False)
    assert found.arms[0].zero_refusal is not None


@pytest.mark.parametrize("rise_V", [0.0, 0.02])
def test_a_zero_requested_for_a_lost_sample_is_not_taken_after_the_voltage_has_changed(
    rise_V: float,
) -> None:
    approach = with_a_zero_due()
    approach.voltage_V += rise_V
    later = approach.feed(1e9)
    assert later.valid
    assert later.arms[0].zero_age_s != 0.0
    # This holds even if the arm rests again.
    again = approach.bench.feed(approach.place(1e9), approach.voltage_V, answered=False)
    assert again.arms[0].zero_age_s != 0.0


@pytest.mark.parametrize("state", [Mode.RAMPING, Mode.FROZEN])
def test_a_zero_is_not_taken_after_a_trip(state: Mode) -> None:
    approach = with_a_zero_due()
    later = approach.bench.feed(
        approach.place(1e9), approach.voltage_V, answered=False, state=state
    )
    assert later.valid
    assert later.arms[0].zero_age_s != 0.0


def test_a_zero_requested_for_a_lost_sample_is_dropped_at_the_end_of_its_epoch() -> None:
    approach = with_a_zero_due()
    approach.bench.arm(2)
    later = approach.bench.feed(approach.place(1e9), approach.voltage_V, answered=False)
    assert later.arms[0].zero_age_s is None
