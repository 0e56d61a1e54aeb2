"""Recommended settings for a machine: each part of the rule by hand calculation, and that the
proposed settings suffice."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.latency.advice import (
    MOST_PERIODS,
    Asked,
    age_change,
    age_periods,
    changes,
    recommended,
)
from pincette.latency.rule import Measured
from tests.support.histograms import counted

T = 0.02
RIG = Asked(T, 2.5, 0.002, 10, ())
HOP = counted([0.0002] * 1000)


def measured(late_s: float) -> Measured:
    return Measured(T, counted([late_s] * 1000), 0)


def test_a_punctual_machine_needs_no_change() -> None:
    assert changes(RIG, measured(1e-4), HOP, "") == []


def test_a_machine_that_stalled_for_31_ms_needs_an_age_limit_of_four_and_a_half_periods() -> None:
    # 20 ms + 2 · 31 ms + 3 · 0.2 ms + 2 ms = 84.6 ms = 4.23 T
    (change,) = changes(RIG, measured(0.031), HOP, "")
    assert (change.key, change.value) == ("[safety] command_age_periods", "4.5")
    assert "31.0 ms, which is counted twice; a fault is then noticed within 90 ms" in change.why
    assert changes(RIG._replace(age_periods=4.5), measured(0.031), HOP, "") == []


def test_if_no_age_limit_is_long_enough_a_longer_period_is_proposed() -> None:
    change = age_change(RIG, 0.2, 0.0026)
    assert change is not None
    assert (change.key, change.value) == ("[rig] period_s", "0.045")
    assert age_periods(0.045, 0.2, 0.0026) <= MOST_PERIODS


def test_a_refused_or_unrequested_priority_is_proposed_first() -> None:
    refused = "fixed priority 10 (SCHED_FIFO)"
    assert [one.key for one in changes(RIG, measured(0.031), HOP, refused)] == [
        "[realtime] priority",
        "[safety] command_age_periods",
    ]
    (first, _) = changes(RIG._replace(priority=0), measured(0.031), HOP, "")
    assert (first.key, first.value) == ("[realtime] priority", "10")
    assert changes(RIG._replace(priority=0), measured(1e-4), HOP, "") == []


def test_slow_transfer_between_programs_leads_to_the_proposal_to_compose_two_services() -> None:
    slow = counted([0.003] * 1000)
    (change,) = changes(RIG, measured(1e-4), slow, "")
    assert (change.key, change.value) == ("[rig] composed", '["estimator+controller"]')
    assert changes(RIG._replace(composed=("loop",)), measured(1e-4), slow, "") == []


@given(
    st.floats(1e-3, 0.1), st.floats(0.0, 1.0), st.floats(0.0, 0.01), st.floats(1.5, MOST_PERIODS)
)
def test_the_proposed_age_limit_leaves_room_for_twice_the_latest_wake_up(
    period_s: float, late_s: float, transit_s: float, age: float
) -> None:
    change = age_change(Asked(period_s, age, 0.0, 10, ()), late_s, transit_s)
    limit_s = age * period_s
    if change is not None and "age" in change.key:
        limit_s = float(change.value) * period_s
    elif change is not None:
        period_s = float(change.value)
        limit_s = MOST_PERIODS * period_s
    assert limit_s >= period_s + 2.0 * late_s + transit_s - 1e-6


@pytest.mark.parametrize("silent_s", [0.0501, 0.051, 0.08])
def test_after_a_trip_a_longer_age_limit_is_proposed(silent_s: float) -> None:
    assert age_change(RIG, silent_s - T, 0.002) is not None


@pytest.mark.parametrize(
    ("late_s", "hop_s", "wanted"),
    [
        (0.00005, 0.0001, (0.001, "fpbsmic", ())),
        (0.00005, 0.0002, (0.001, "fpbsmic", ("loop",))),
        (0.0003, 0.0002, (0.02, "pbsmic", ())),
        (0.0003, 0.004, (0.02, "pbsmic", ("loop",))),
        (0.003, 0.0002, None),
    ],
)
def test_the_fastest_supported_law_is_recommended(
    late_s: float, hop_s: float, wanted: tuple[float, str, tuple[str, ...]] | None
) -> None:
    grids = [Measured(one, counted([late_s] * 1000), 0) for one in (0.02, 0.002, 0.001)]
    assert recommended(grids, counted([hop_s] * 1000)) == wanted
