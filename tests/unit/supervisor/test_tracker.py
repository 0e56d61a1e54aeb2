"""Progress towards a hold without an end, and the force once it has settled."""

from itertools import pairwise

import pytest

from pincette.api.jobs import Progress
from pincette.core.messages import Message
from pincette_supervisor.jobs.tracker import SETTLE_S, Tracker

from . import samples
from .samples import PERIOD_S

HOLD_AT_S = 6.0


def followed(hold_at_s: float | None) -> list[Progress]:
    """The progress after each tick of the canned grip."""
    ticks = list(samples.grip())
    tracker = Tracker(ticks[0].position.epoch, PERIOD_S, None, lockstep=True, hold_at_s=hold_at_s)
    found: list[Progress] = []
    for tick in ticks:
        messages: list[Message] = [tick.position, tick.estimate, tick.applied, tick.telemetry]
        tracker.update(messages)
        found.append(tracker.progress())
    return found


def test_the_way_to_the_hold_is_told_where_the_hold_has_no_end() -> None:
    found = followed(HOLD_AT_S)
    assert all(one.percent is None for one in found)
    before = [one.hold_in_s for one in found if one.phase in ("zero", "approach", "contact")]
    assert before[0] == pytest.approx(HOLD_AT_S - PERIOD_S)
    assert all(first >= second for first, second in pairwise(one or 0.0 for one in before))
    assert {one.hold_in_s for one in found if one.phase == "hold"} == {0.0}
    after = found[[one.phase for one in found].index("unload") :]
    assert {one.hold_in_s for one in after} == {None}
    assert {one.hold_in_s for one in followed(None) if one.phase != "hold"} == {None}


def test_the_force_held_is_told_once_it_has_settled() -> None:
    found = followed(HOLD_AT_S)
    hold = [one for one in found if one.phase == "hold"]
    waits = [one for one in hold if one.force_held_mN is None]
    assert len(waits) == pytest.approx(SETTLE_S / PERIOD_S, abs=1)
    settled = [one.force_mN for one in hold[len(waits) :] if one.force_mN is not None]
    assert hold[-1].force_held_mN == pytest.approx(sum(settled) / len(settled))
    assert found[-1].force_held_mN == pytest.approx(hold[-1].force_held_mN, abs=0.05)
