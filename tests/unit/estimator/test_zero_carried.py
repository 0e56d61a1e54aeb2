"""The zero for a part that one arm still holds continues in the next epoch, if this is
requested."""

import pytest

from pincette.core.messages import Arm, Estimate
from pincette.engine.request_log import restored, snapshot
from pincette_estimator.config import configure
from pincette_estimator.step import SERVICE, handle, start

from .bench import DEMO, Bench

PERIOD_S = DEMO.rig.period_s
AT_V, HELD_UM = 1.0, 12.0
HELD_SAMPLES = 50


def held_bench() -> Bench:
    """Return an estimator whose force was zeroed, and that then follows a held part for a while."""
    bench = Bench(configure(DEMO))
    bench.rest(0.0, 0.0, 30)
    assert bench.feed(0.0, 0.0, zero=True).arms[0].zero_age_s == 0.0
    for _ in range(HELD_SAMPLES):
        bench.feed(HELD_UM, AT_V, held=True)
    return bench


def armed(bench: Bench, *, zero_kept: bool, held: bool = True) -> Estimate:
    """Return the first estimate of the next epoch."""
    request = Arm(2, 1, "", zero_kept=zero_kept)
    bench.state, _, _ = handle(bench.config, bench.state, request, 0.0)
    bench.epoch, bench.seq = 2, 0
    return bench.feed(HELD_UM, AT_V, held=held)


def test_force_and_zero_age_continue_after_an_arming_that_keeps_the_zero() -> None:
    bench = held_bench()
    before = bench.feed(HELD_UM, AT_V, held=True).arms[0]
    arm = armed(bench, zero_kept=True).arms[0]
    assert arm.force_mN == pytest.approx(before.force_mN, abs=0.05)
    assert arm.zero_age_s == pytest.approx(before.zero_age_s, abs=2.0 * PERIOD_S)
    assert arm.force_uncertainty_mN >= before.force_uncertainty_mN - 0.01
    assert bench.feed(HELD_UM, AT_V, held=True).arms[0].zero_age_s == pytest.approx(
        (arm.zero_age_s or 0.0) + PERIOD_S
    )


def test_the_zero_is_carried_into_a_third_epoch_too() -> None:
    bench = held_bench()
    first = armed(bench, zero_kept=True).arms[0].zero_age_s
    for _ in range(HELD_SAMPLES):
        bench.feed(HELD_UM, AT_V, held=True)
    second = armed(bench, zero_kept=True).arms[0].zero_age_s
    assert first is not None
    assert second == pytest.approx(first + HELD_SAMPLES * PERIOD_S, abs=2.0 * PERIOD_S)


@pytest.mark.parametrize(("zero_kept", "held"), [(False, True), (True, False)])
def test_a_zero_is_kept_over_an_arming_only_on_request_and_with_a_held_part(
    zero_kept: bool, held: bool
) -> None:
    assert armed(held_bench(), zero_kept=zero_kept, held=held).arms[0].zero_age_s is None


def test_an_estimator_without_a_zero_starts_an_epoch_without_one() -> None:
    bench = Bench(configure(DEMO))
    for _ in range(HELD_SAMPLES):
        bench.feed(HELD_UM, AT_V, held=True)
    assert armed(bench, zero_kept=True).arms[0].zero_age_s is None


def test_a_replay_starts_with_the_same_zero() -> None:
    bench = held_bench()
    request = Arm(2, 1, "", zero_kept=True)
    state, _, _ = handle(bench.config, bench.state, request, 0.0)
    text = snapshot(SERVICE, bench.config, state)
    again = restored(SERVICE, bench.config, start(bench.config), text)
    assert again.arms[0].zero_s == state.arms[0].zero_s
    assert again.arms[0].zero_s is not None
    assert again.arms[0].zero_s < 0.0
