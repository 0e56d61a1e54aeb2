"""An idle rig samples rarely: its estimates stay valid, and an arming ends the slow sampling at
once."""

from itertools import pairwise

import pytest

from pincette.core.faults import Mode
from pincette.core.idle_sampling import SAMPLE_S, idle_periods
from pincette.core.messages import Applied, Estimate, Idle, Position
from pincette.engine.arming import ORDER
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_places import EPOCH, T, begun, near_rig, program_at

PERIODS = idle_periods(T)
IDLE_FOR_S = 3.0


def is_over(loop: VirtualLoop) -> bool:
    return loop.newest.epoch == EPOCH and loop.newest.final


@pytest.fixture(scope="module")
def ended() -> VirtualLoop:
    """A rig whose program has ended."""
    loop = begun()
    assert loop.run(loop.now_s + 60.0, lambda: is_over(loop))
    loop.run(loop.now_s + 0.2)
    return loop


def published(loop: VirtualLoop, kind: type) -> list[tuple[float, object]]:
    return [(at_s, one) for at_s, one in loop.told or [] if isinstance(one, kind)]


def idle(ended: VirtualLoop, seed: int) -> VirtualLoop:
    loop = ended.fork(seed)
    loop.must("sensor", Idle(EPOCH))
    loop.run(loop.now_s + IDLE_FOR_S)
    return loop


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_idle_rig_samples_rarely_and_keeps_its_time_grid(ended: VirtualLoop, seed: int) -> None:
    loop = idle(ended, seed)
    found = [(at_s, one) for at_s, one in published(loop, Position) if isinstance(one, Position)]
    seldom = found[-int(IDLE_FOR_S / SAMPLE_S) + 2 :]
    assert {later.seq - one.seq for (_, one), (_, later) in pairwise(seldom)} == {PERIODS}
    for (before_s, _), (after_s, _) in pairwise(seldom):
        assert after_s - before_s == pytest.approx(SAMPLE_S, abs=0.5 * T)
    assert loop.runner("sensor").missed == ended.runner("sensor").missed


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_each_sample_has_a_valid_estimate_and_a_reply(ended: VirtualLoop, seed: int) -> None:
    loop = idle(ended, seed)
    positions = [one for _, one in published(loop, Position) if isinstance(one, Position)][:-1]
    estimates = {one.seq: one for _, one in published(loop, Estimate) if isinstance(one, Estimate)}
    answers = {one.seq for _, one in published(loop, Applied) if isinstance(one, Applied)}
    for position in positions[1:]:
        assert not estimates[position.seq].degraded
        assert estimates[position.seq].applied_seq == position.seq - 1
        assert position.seq in answers


def test_hysteresis_and_creep_of_an_idle_arm_advance_with_elapsed_time(ended: VirtualLoop) -> None:
    seldom, often = idle(ended, 1), ended.fork(1)
    often.run(seldom.now_s)
    (one,), (other,) = (loop.runner("estimator").state.arms for loop in (seldom, often))
    assert other.followed_seq - one.followed_seq in range(PERIODS + 1)
    assert one.response.position_um() == pytest.approx(other.response.position_um(), abs=1e-3)
    assert one.unknown == other.unknown or one.unknown.known == other.unknown.known


def test_an_arming_ends_the_slow_sampling_at_once(ended: VirtualLoop) -> None:
    loop = idle(ended, 1)
    loop.run(loop.now_s + 0.5 * SAMPLE_S)
    loop.told = []
    loop.arm(program_at(T), EPOCH + 1)
    armed_s = loop.now_s
    loop.run(armed_s + 1.0)
    found = [
        (at_s, one.seq)
        for at_s, one in published(loop, Position)
        if isinstance(one, Position) and one.epoch == EPOCH + 1
    ]
    assert found[0][0] - armed_s <= 1.5 * T
    assert [seq for _, seq in found[:40]] == list(range(40))
    assert loop.newest.state == Mode.ARMED


def test_a_request_for_another_epoch_is_refused(ended: VirtualLoop) -> None:
    loop = ended.fork(1)
    loop.must("sensor", Idle(EPOCH))
    reply = loop.call("sensor", Idle(EPOCH - 1))
    assert isinstance(reply, str)
    loop.arm(program_at(T), EPOCH + 1)
    assert isinstance(loop.call("sensor", Idle(EPOCH)), str), (
        "a late request would slow an armed loop"
    )


def test_a_rig_that_was_never_armed_may_sample_slowly() -> None:
    loop = VirtualLoop(near_rig())
    loop.run(loop.now_s + 3.0 * T)
    loop.must("sensor", Idle(0))
    loop.run(loop.now_s + IDLE_FOR_S)
    count = len(published(loop, Position))
    assert count <= IDLE_FOR_S / SAMPLE_S + 6
    assert ORDER[-1] == "sensor"
