"""Supported period: each part of the rule, at its limit and beyond it."""

from itertools import chain, repeat

import pytest

from pincette.latency.rule import Measured, objections, shortest_supported_s
from tests.support.histograms import counted

T = 0.02


def measured(*late_s: float, period_s: float = T, count: int = 10_000) -> Measured:
    """Return some late wake-ups among those that are 10 µs late."""
    filled = chain(late_s, repeat(1e-5, count - len(late_s)))
    return Measured(period_s, counted(filled), 0)


def test_a_punctual_machine_supports_the_period() -> None:
    assert objections(measured()) == ()
    assert objections(measured(0.49 * T)) == ()
    assert objections(measured(*[0.09 * T] * 100)) == ()


def test_a_late_p99_9_rules_out_the_period() -> None:
    (why,) = objections(measured(*[0.11 * T] * 11))
    assert why.startswith("p99.9 of the lateness: 2.2")
    assert why.endswith("limit 0.1 T = 2 ms")


def test_a_single_very_late_wake_up_rules_out_the_period() -> None:
    (why,) = objections(measured(0.51 * T))
    assert why == "the latest wake-up: 10.2 ms, limit 0.5 T = 10 ms"


def test_slow_transfer_between_programs_rules_out_the_period() -> None:
    assert objections(measured(), counted([0.12 * T] * 1000)) == ()
    (why,) = objections(measured(), counted([0.13 * T] * 1000))
    assert why.startswith("4 hops at their p99.9: 10.")


def test_too_few_wake_ups_give_no_verdict() -> None:
    (why,) = objections(measured(count=99))
    assert why == "99 wake-ups, too few for a judgement: 100 are needed"
    assert objections(measured(count=100)) == ()
    assert objections(Measured(T, counted([]), 0))


@pytest.mark.parametrize(
    ("fails", "shortest_s"),
    [((), 0.001), ((0.001,), 0.005), ((0.005,), 0.02), ((0.02,), None), ((0.001, 0.02), None)],
)
def test_the_shortest_period_is_supported_with_every_longer_one(
    fails: tuple[float, ...], shortest_s: float | None
) -> None:
    all_of_them = [
        measured(*([0.6 * period_s] if period_s in fails else []), period_s=period_s)
        for period_s in (0.001, 0.02, 0.005)
    ]
    assert shortest_supported_s(all_of_them) == shortest_s
