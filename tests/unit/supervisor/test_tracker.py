"""Progress towards a hold without an end, and the force once it has settled."""

from itertools import pairwise

import pytest

from pincette.api.jobs import Progress
from pincette.control.record import replace
from pincette.core.faults import FaultCode, Outcome, fault
from pincette.core.messages import Estimate, Message
from pincette.core.wording import fault_text
from pincette_supervisor.jobs.tracker import SETTLE_S, Tracker, outcome_words
from tests.support.arms import with_arm

from . import samples
from .samples import PERIOD_S

HOLD_AT_S = 6.0


APART_MN = 1.5
"""Difference of the commanded forces of the second arm and the first, in mN."""


def with_second(estimate: Estimate) -> Estimate:
    """Return the same for a rig of two arms."""
    first = estimate.arms[0]
    return replace(estimate, arms=(first, replace(first, force_mN=first.force_mN + APART_MN)))


def followed(hold_at_s: float | None, *, arms: int = 1) -> list[Progress]:
    """Return the progress after each tick of the prepared grip."""
    ticks = list(samples.grip())
    tracker = Tracker(ticks[0].position.epoch, PERIOD_S, None, lockstep=True, hold_at_s=hold_at_s)
    found: list[Progress] = []
    for tick in ticks:
        estimate = tick.estimate if arms == 1 else with_second(tick.estimate)
        messages: list[Message] = [tick.position, estimate, tick.applied, tick.telemetry]
        tracker.update(messages)
        found.append(tracker.progress())
    return found


def test_the_time_to_an_endless_hold_is_reported() -> None:
    found = followed(HOLD_AT_S)
    assert all(one.percent is None for one in found)
    before = [one.hold_in_s for one in found if one.phase in ("zero", "approach", "contact")]
    assert before[0] == pytest.approx(HOLD_AT_S - PERIOD_S)
    assert all(first >= second for first, second in pairwise(one or 0.0 for one in before))
    assert {one.hold_in_s for one in found if one.phase == "hold"} == {0.0}
    after = found[[one.phase for one in found].index("unload") :]
    assert {one.hold_in_s for one in after} == {None}
    assert {one.hold_in_s for one in followed(None) if one.phase != "hold"} == {None}


def test_the_force_held_is_reported_once_it_has_settled() -> None:
    found = followed(HOLD_AT_S)
    hold = [one for one in found if one.phase == "hold"]
    waits = [one for one in hold if one.force_held_mN is None]
    assert len(waits) == pytest.approx(SETTLE_S / PERIOD_S, abs=1)
    settled = [one.force_mN for one in hold[len(waits) :] if one.force_mN is not None]
    assert hold[-1].force_held_mN == pytest.approx(sum(settled) / len(settled))
    assert found[-1].force_held_mN == pytest.approx(hold[-1].force_held_mN, abs=0.05)


def test_the_force_held_is_the_mean_of_two_arms() -> None:
    one, two = followed(HOLD_AT_S), followed(HOLD_AT_S, arms=2)
    alone_mN, both_mN = one[-1].force_held_mN, two[-1].force_held_mN
    assert alone_mN is not None
    assert both_mN == pytest.approx(alone_mN + 0.5 * APART_MN)
    assert [now.force_mN for now in two] == [now.force_mN for now in one]


def test_no_phase_is_missed_if_many_samples_arrive_at_once() -> None:
    ticks = list(samples.grip())
    tracker = Tracker(ticks[0].position.epoch, PERIOD_S, None, lockstep=True)
    tracker.update([tick.telemetry for tick in ticks])
    begun = [
        ticks[0].telemetry,
        *(b.telemetry for a, b in pairwise(ticks) if a.telemetry.phase != b.telemetry.phase),
    ]
    assert tracker.phases == [(one.phase, one.seq, one.held) for one in begun]
    assert len(begun) > 4


def test_a_refused_zero_states_its_reason_or_that_its_sample_was_lost() -> None:
    refusal = fault(FaultCode.ZERO_PART_HELD)
    estimate = next(iter(samples.grip())).estimate
    refused = with_arm(estimate, zero_refusal=refusal)
    assert fault_text(refusal) in outcome_words(Outcome.ZERO_REFUSED, None, refused)
    assert "lost" in outcome_words(Outcome.ZERO_REFUSED, None, with_arm(refused, zero_refusal=None))
    assert "lost" in outcome_words(Outcome.ZERO_REFUSED)


@pytest.mark.parametrize(
    ("touch_mN", "words"),
    [
        (3.0, "touched something on its way through free space, at 12.00 µm, and went back at 3.0"),
        (-3.0, "the free arm was pulled with 3.0 mN at 12.00 µm, or the zero of its force is"),
    ],
)
def test_a_free_arm_that_is_pulled_is_not_reported_as_having_touched_something(
    touch_mN: float, words: str
) -> None:
    telemetry = replace(next(iter(samples.grip())).telemetry, touch_x_um=12.0, touch_mN=touch_mN)
    assert words in outcome_words(Outcome.CONTACT, telemetry)


@pytest.mark.parametrize("unconfirmed", [False, True])
def test_the_progress_has_only_a_voltage_that_the_output_has_confirmed(
    unconfirmed: bool,
) -> None:
    tick = next(iter(samples.grip()))
    tracker = Tracker(tick.position.epoch, PERIOD_S, None, lockstep=True)
    tracker.update([tick.position, tick.telemetry, replace(tick.applied, unconfirmed=unconfirmed)])
    shown_V = tracker.progress().voltage_V
    assert shown_V == (None if unconfirmed else tick.applied.arms[0].voltage_V)
