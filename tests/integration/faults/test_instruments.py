"""Faults of instruments and of the bench during a grip, in virtual time, and their outcomes.

../shared/faults.md has the table. A sensor's fault is identified by its samples, an output's by the
actuator's cause. Each fault has a counterpart that must not trip.
"""

from math import isfinite

import pytest

from pincette.core.wording import applied_text, fault_text
from tests.support.rigs import Tree
from tests.support.scripted import TRIPPED, Played, T, play

CLEAN = play()
APPROACH = CLEAN.begin_of("approach") + 15
LOAD = CLEAN.begin_of("load") + 5
HOLD = CLEAN.begin_of("hold") + 10
FREE_OR_HELD = pytest.mark.parametrize(
    ("seq", "state"),
    [(APPROACH, "ramping"), (LOAD, "frozen"), (HOLD, "frozen")],
    ids=["approach", "load", "hold"],
)
FORCE_MAX_MN = 40.0
FREEZE_S = 0.4
RAMP_TICKS = 2
"""Number of ticks in 35 ms."""


def at(seq: int, target: str, what: str, **more: float) -> Tree:
    """Return an entry of the rig file that takes effect from a given sample on."""
    return {"at_s": seq * T, "target": target, "what": what, **more}


def check_safe(played: Played, state: str, seq: int) -> None:
    """Check that the rig tripped at ``seq`` into ``state``, made the required ramp or freeze, and
    accepted no command afterwards."""
    trip = played.trip
    assert trip is not None
    assert (trip.seq, trip.state) == (seq, state)
    after = [echo for echo in played.applied if echo.seq >= trip.seq]
    assert not any(echo.answered for echo in after)
    assert (after[-1].state, after[-1].arms[0].voltage_V, after[-1].final) == ("latched", 0.0, True)
    kept_V = next(echo.arms[0].voltage_V for echo in played.applied if echo.seq == trip.seq - 1)
    frozen = [echo for echo in after if echo.state == "frozen"]
    assert {echo.arms[0].voltage_V for echo in frozen} <= {kept_V}
    # The end of the freeze falls on a tick, or after it by a rounding error.
    assert len(frozen) - (round(FREEZE_S / T) if state == "frozen" else 0) in (0, 1)
    assert len(after) - len(frozen) <= RAMP_TICKS + 1


def check_untripped(played: Played) -> None:
    assert played.trip is None
    assert {echo.state for echo in played.applied} <= {"armed", "idle"}


def test_a_grip_without_a_fault_succeeds() -> None:
    check_untripped(CLEAN)
    assert CLEAN.outcome == "gripped"
    assert all(position.arms[0].valid for position in CLEAN.positions)
    assert all(estimate.valid for estimate in CLEAN.estimates)


def test_a_lost_bead_ends_the_grip_as_lost_without_a_trip() -> None:
    played = play(at(HOLD, "part", "lose"))
    assert played.outcome == "lost"
    check_untripped(played)
    assert [event.what for event in played.rig.events()] == ["lost"]
    assert played.begin_of("retreat") <= HOLD + 7


def test_a_bead_removed_before_contact_is_not_found() -> None:
    played = play(at(APPROACH, "part", "remove"))
    assert played.outcome == "no_contact"
    check_untripped(played)


def test_a_bead_at_another_place_is_found_there() -> None:
    played = play(at(2, "part", "remove"), at(5, "part", "place", value=7.0))
    assert played.outcome == "gripped"
    check_untripped(played)


def test_a_bead_that_breaks_in_the_hold_is_lost() -> None:
    changes: Tree = {"simulation": {"part": {"break_force_mN": 16.0}}}
    played = play(at(HOLD, "arm", "stiffen", value=3.0), changes=changes)
    assert "broken" in [event.what for event in played.rig.events()]
    assert played.outcome == "lost"
    check_untripped(played)
    assert play(changes=changes).outcome == "gripped"


def test_a_force_above_the_limit_ends_the_grip_and_releases() -> None:
    played = play(at(HOLD, "weight", "hang", value=FORCE_MAX_MN))
    assert played.outcome == "overforce"
    check_untripped(played)
    # The weight still pulls, and the arm does not rise against it.
    assert played.positions[-1].arms[0].x_um < 1.0
    assert played.truths[-1].arms[0].force_mN == 0.0
    lighter = play(at(HOLD, "weight", "hang", value=2.0))
    # The arm moves back at once only if the sensor, or what pushes the part, moves it.
    assert lighter.outcome == "sensor_jump"
    check_untripped(lighter)


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("over_range", "Keyence: above the measuring range"),
        ("off", "no answer to b'MS,01'"),
        ("garbage", "Keyence: "),
    ],
)
@FREE_OR_HELD
def test_the_third_sample_in_a_row_that_is_invalid_trips(
    what: str, said: str, seq: int, state: str
) -> None:
    played = play(at(seq, "sensor", what))
    check_safe(played, state, seq + 2)
    bad = [position for position in played.positions if position.seq >= seq]
    assert all(
        not position.arms[0].valid and said in fault_text(position.arms[0].fault)
        for position in bad
    )
    assert "command_age" in played.applied[-1].cause
    for count in (1, 2):
        twin = play(at(seq, "sensor", what, for_s=count * T))
        assert [position.seq for position in twin.positions if not position.arms[0].valid] == [
            seq + place for place in range(count)
        ]
        check_untripped(twin)
        assert twin.outcome == "gripped"


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_reading_out_of_range_names_the_side(side: float) -> None:
    played = play(at(HOLD, "sensor", "over_range", value=side))
    fault = fault_text(played.positions[-1].arms[0].fault)
    assert ("above" if side > 0.0 else "below") in fault


@pytest.mark.parametrize(("seq", "state"), [(APPROACH, "ramping"), (LOAD, "frozen")])
def test_a_stuck_sensor_is_found_within_ten_samples_while_the_voltage_moves(
    seq: int, state: str
) -> None:
    played = play(at(seq, "sensor", "stuck"))
    refused = [estimate.seq for estimate in played.estimates if not estimate.valid]
    assert refused[0] - seq < 10
    assert played.trip is not None
    assert played.trip.seq - seq < 10
    check_safe(played, state, played.trip.seq)
    assert max(truth.arms[0].force_mN for truth in played.truths) < FORCE_MAX_MN


def test_a_stuck_sensor_does_not_trip_while_the_arm_is_at_rest() -> None:
    # In a hold the law follows the creep: from the eighth sample on, the voltage has changed
    # enough.
    for seq, count in ((1, 12), (HOLD, 7)):
        played = play(at(seq, "sensor", "stuck", for_s=count * T))
        stuck = {position.arms[0].x_um for position in played.positions[seq : seq + count]}
        assert len(stuck) == 1
        check_untripped(played)
        # In a hold the reading jumps when it returns.
        assert played.outcome == ("position_step" if seq == HOLD else "gripped")


@pytest.mark.parametrize("what", ["off", "garbage"])
@FREE_OR_HELD
def test_an_output_that_does_not_confirm_trips_at_once_and_is_named(
    what: str, seq: int, state: str
) -> None:
    played = play(at(seq, "output", what))
    trip = played.trip
    assert trip is not None
    assert (trip.seq, trip.state) == (seq, state)
    assert trip.cause == "device"
    assert played.applied[-1].state == "latched"
    assert ("no answer to b'#010" if what == "off" else "I-7024") in applied_text(trip)


def test_a_tripped_watchdog_of_the_output_is_a_trip_that_is_named() -> None:
    """The instrument received no message from its host for 1 s, and reports this at the next
    write."""
    played = play(host_stands_at_s=HOLD * T)
    assert played.trip is not None
    assert (played.trip.seq, played.trip.state) == (HOLD, "frozen")
    assert "host watchdog has tripped" in applied_text(played.trip)
    assert played.applied[-1].state == "latched"
    unwatched: Tree = {"output": {"options": {"watchdog_s": 0.0}}}
    check_untripped(play(changes=unwatched, host_stands_at_s=HOLD * T))


@pytest.mark.parametrize("share", [0.0, 0.05, 0.2, 1.0])
def test_an_intermittent_sensor_continues_or_trips(share: float) -> None:
    played = play(at(0, "sensor", "intermittent", value=share))
    bad = [not position.arms[0].valid for position in played.positions]
    in_a_row = any(bad[place : place + 3] == [True] * 3 for place in range(len(bad)))
    assert (played.trip is not None) == in_a_row
    assert played.applied[-1].final
    assert bad.count(True) == 0 or share > 0.0
    if not in_a_row:
        assert played.outcome == "gripped"
    assert share < 0.2 or in_a_row


def test_an_intermittent_output_trips_at_its_first_loss() -> None:
    played = play(at(0, "output", "intermittent", value=0.05))
    assert played.trip is not None
    assert played.trip.cause == "device"
    assert played.applied[-1].state == "latched"


@pytest.mark.parametrize("target", ["sensor", "output"])
@FREE_OR_HELD
def test_a_late_answer_is_not_accepted(target: str, seq: int, state: str) -> None:
    limit_s = 0.1
    assert play(at(seq, target, "slow", value=limit_s)).trip is None
    played = play(at(seq, target, "slow", value=1.01 * limit_s))
    assert played.trip is not None
    assert played.trip.state == state
    assert played.trip.seq - seq == (2 if target == "sensor" else 0)


@pytest.mark.parametrize("periods", [1, 3, 5])
@pytest.mark.parametrize("target", ["sensor", "output"])
@pytest.mark.parametrize("seq", [0, APPROACH, HOLD])
def test_old_readings_never_lead_to_too_much_force(target: str, periods: int, seq: int) -> None:
    """An old reading is not detected by any age limit, but the guards bound its effect."""
    played = play(at(seq, target, "delayed", value=periods * T))
    assert max(truth.arms[0].force_mN for truth in played.truths) < FORCE_MAX_MN
    assert played.applied[-1].final
    if periods <= 2:
        check_untripped(played)
    if periods == 1:
        assert played.outcome == "gripped"


@pytest.mark.parametrize("value", [5.0, -5.0])
def test_a_jump_of_the_sensor_does_not_let_the_true_force_exceed_its_limit(value: float) -> None:
    played = play(at(HOLD, "sensor", "wrong", value=value))
    assert max(truth.arms[0].force_mN for truth in played.truths) < FORCE_MAX_MN
    assert played.applied[-1].final


def test_a_faulty_grip_can_be_repeated_bit_for_bit() -> None:
    orders = (
        at(0, "sensor", "intermittent", value=0.05),
        at(APPROACH, "arm", "hysteresis", value=1.1),
        at(HOLD, "sensor", "garbage", for_s=2 * T),
    )
    first, second = play(*orders), play(*orders)
    assert first.told == second.told
    assert first.told != CLEAN.told


def test_all_numbers_of_a_faulty_grip_are_finite() -> None:
    for what in ("garbage", "over_range", "stuck", "off"):
        played = play(at(LOAD, "sensor", what))
        assert all(
            isfinite(estimate.arms[0].force_mN) and isfinite(estimate.arms[0].perturbation_mN)
            for estimate in played.estimates
        )
        assert all(echo.state in ("armed", "idle", "latched", *TRIPPED) for echo in played.applied)
