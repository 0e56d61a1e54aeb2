"""Counters of a rig's samples: trips, ages, gaps, peaks; none of them ever decreases."""

from collections.abc import Iterable

import pytest
from msgspec.structs import replace

from pincette.core.faults import CAUSES, Mode
from pincette.core.messages import Applied, Message, Status, Timing
from pincette.core.topics import TOPIC_OF
from pincette_supervisor.rigs.counters import BOUNDS_S, FORCE_BOUNDS_MN, RigCounters
from tests.support.arms import with_arm
from tests.support.histograms import counted
from tests.unit.supervisor.canned import trip_reason

from . import samples


def fed(messages: Iterable[Message], counters: RigCounters | None = None) -> RigCounters:
    counters = counters or RigCounters()
    for message in messages:
        counters.take(TOPIC_OF[type(message)], message)
    return counters


def of_grip(epoch: int = 7) -> list[Message]:
    return [message for tick in samples.grip(epoch) for message in tick.messages()]


def applied(state: str, cause: str = "", *, seq: int = 0) -> Applied:
    last = samples.grip()[0].applied
    code, faults = trip_reason(cause)
    return replace(last, state=Mode(state), cause=code, faults=faults, seq=seq, answered=False)


def trips(counters: RigCounters) -> dict[str, int]:
    return {cause.value: count for cause, count in counters.trips().items() if count}


def test_a_trip_is_counted_once_however_long_it_lasts() -> None:
    states = [applied("armed"), applied("frozen", "command_age: 61 ms")]
    states += [applied("ramping", "command_age: 61 ms"), applied("latched", "command_age: 61 ms")]
    counters = fed([*states, *states[1:]])
    assert trips(counters) == {"command_age": 1}
    fed([applied("idle"), applied("latched", "estop")], counters)
    assert trips(counters) == {"command_age": 1, "estop": 1}


def test_trips_have_a_counter_for_each_known_cause_only() -> None:
    requests = [applied("latched", f"asked: invented {number}") for number in range(50)]
    counters = fed([state for one in requests for state in (one, applied("idle"))])
    assert set(counters.trips()) == set(CAUSES)
    assert trips(counters) == {"asked": 50}


def test_a_latch_from_before_the_start_is_not_counted_as_a_trip_but_the_next_one_is() -> None:
    counters = fed([applied("latched", "boot")] * 3, RigCounters(applied("latched", "boot")))
    assert trips(counters) == {}
    fed([applied("idle"), applied("latched", "boot")], counters)
    assert trips(counters) == {"boot": 1}


def test_counted_ages_are_those_of_accepted_commands() -> None:
    ages_s = (0.003, 0.0031, 0.3)
    taken = [replace(applied("armed"), answered=True, command_age_s=age_s) for age_s in ages_s]
    counters = fed([*taken, applied("armed"), applied("idle")])
    ages = counters.command_ages()
    assert ages.counts[BOUNDS_S.index(0.002)] == 0
    assert ages.counts[BOUNDS_S.index(0.005)] == 2
    assert ages.counts[BOUNDS_S.index(0.5)] == ages.counts[-1] == 3
    assert ages.sum_s == pytest.approx(sum(ages_s))
    assert counters.unanswered == 1


def test_the_peak_of_an_arming_is_its_highest_valid_force() -> None:
    ticks = samples.grip()
    true_mN = max(tick.estimate.arms[0].force_mN for tick in ticks if tick.estimate.valid)
    counters = RigCounters()
    assert counters.peaks().newest_mN is None
    fed(of_grip(), counters)
    peaks = counters.peaks()
    assert peaks.newest_mN == pytest.approx(true_mN)
    assert peaks.sum_mN == pytest.approx(true_mN)
    place = next(place for place, bound in enumerate(FORCE_BOUNDS_MN) if bound >= true_mN)
    assert peaks.counts == tuple(int(at >= place) for at in range(len(FORCE_BOUNDS_MN) + 1))
    invalid = with_arm(ticks[-1].estimate, epoch=9, force_mN=1e6, valid=False)
    assert fed([invalid], counters).peaks() == peaks
    fed(of_grip(8), counters)
    assert counters.peaks().counts[-1] == 2


def test_an_estimate_outside_an_arming_is_not_counted_as_a_peak() -> None:
    held = max((tick.estimate for tick in samples.grip()), key=lambda one: one.arms[0].force_mN)
    counters = fed([replace(held, epoch=0), replace(held, epoch=3)])
    assert counters.peaks().newest_mN is None
    fed(of_grip(), counters)
    fed([with_arm(held, force_mN=99.0)], counters)  # after its last sample
    assert counters.peaks().counts[-1] == 1
    assert counters.peaks().newest_mN == pytest.approx(held.arms[0].force_mN)


def test_the_peak_of_an_arming_whose_end_was_lost_is_counted_when_the_next_arming_has_a_force() -> (
    None
):
    cut = [message for tick in samples.grip(7)[:180] for message in tick.messages()]
    counters = fed(cut)
    assert counters.peaks().counts[-1] == 0
    fed(of_grip(8), counters)
    assert counters.peaks().counts[-1] == 2


def test_lost_messages_of_a_grip_are_counted_as_gaps() -> None:
    assert set(fed(of_grip()).gaps().values()) == {0}
    ticks = samples.grip()
    holed = [tick for tick in ticks if not 50 <= tick.position.seq < 53]
    counters = fed(message for tick in holed for message in tick.messages())
    assert counters.gaps() == dict.fromkeys(
        ("position", "estimate", "command", "telemetry", "applied"), 3
    )


def test_numbers_skipped_by_an_idle_loop_are_not_gaps() -> None:
    counters = fed([applied("idle", seq=3), applied("latched", "estop", seq=900)])
    assert counters.gaps()["applied"] == 0


def timing(epoch: int, missed: int, lateness_s: list[float], service: str = "sensor") -> Timing:
    histogram = counted(lateness_s)
    return replace(
        samples.timing(service, 5), epoch=epoch, missed=missed, lateness=histogram, age=histogram
    )


def test_reported_counts_continue_over_armings_and_restarts() -> None:
    counters = fed([timing(1, 2, [0.001, 0.004]), timing(1, 3, [0.001, 0.004, 0.004])])
    assert counters.missed()["sensor"] == 3
    fed([timing(2, 1, [0.002]), timing(0, 4, [0.03])], counters)
    assert counters.missed() == {"sensor": 8, "estimator": 0, "controller": 0, "actuator": 0}
    lateness = counters.durations("sensor", "lateness")
    assert lateness.counts[-1] == 5
    assert lateness.sum_s == pytest.approx(0.041, rel=1 / 64)
    assert counters.durations("actuator", "lateness").counts[-1] == 0


def test_an_invalid_service_is_not_counted() -> None:
    counters = fed([timing(1, 9, [0.1], service=f"invented-{number}") for number in range(20)])
    assert counters.missed() == dict.fromkeys(("sensor", "estimator", "controller", "actuator"), 0)


def test_refused_and_lost_counts_continue_over_a_restart() -> None:
    def status(service: str, instance: int, missed: int, refused: int) -> Status:
        return Status(service, "0", instance, "", 0, 0, missed, refused)

    counters = RigCounters()
    for one in (
        status("recorder", 1, 4, 2),
        status("recorder", 2, 5, 3),
        status("actuator", 1, 0, 7),
        status("actuator", 1, 0, 9),
        status("invented", 1, 1, 1),
    ):
        counters.update_status(one)
    assert counters.lost.total == 9
    refused = {service: count for service, count in counters.refused().items() if count}
    assert refused == {"recorder": 5, "actuator": 9}


def test_an_estimate_without_a_zero_is_not_counted_as_a_peak() -> None:
    held = max((tick.estimate for tick in samples.grip()), key=lambda one: one.arms[0].force_mN)
    unzeroed = with_arm(held, force_mN=99.0, zero_age_s=None)
    counters = RigCounters()
    fed([*of_grip()[:-3], unzeroed, *of_grip()[-3:]], counters)
    assert counters.peaks().newest_mN == pytest.approx(held.arms[0].force_mN)
