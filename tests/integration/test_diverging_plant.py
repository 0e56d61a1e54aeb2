"""The arm differs from the model: the job ends with a trip or by a guard, and the force is bounded.

A wrong gain, a reading of the wrong sign, three times the hysteresis; and the counterparts that
must not trip: a lost part, twice the hysteresis, a part three times as stiff.
"""

import pytest

from pincette.core.wording import applied_text
from tests.support.rigs import Tree
from tests.support.scripted import Played, T, play

CLEAN = play()
APPROACH = CLEAN.begin_of("approach") + 15
LOAD = CLEAN.begin_of("load") + 5
HOLD = CLEAN.begin_of("hold") + 10
FORCE_MAX_MN, HARD_MN = 40.0, 50.0
GAIN_UM_PER_V = 24.95
"""Gain of the demo rig's simulation, in µm/V."""
GUARDED = (
    "overforce",
    "no_contact",
    "zero_refused",
    "wrong_stiffness",
    "lost",
    "contact",
    "slipped",
    "sensor_jump",
    "position_step",
)


def at(seq: int, target: str, what: str, **more: float) -> Tree:
    return {"at_s": seq * T, "target": target, "what": what, **more}


def check_ended(played: Played) -> None:
    """Check that the job ended with a trip whose cause names the limit, or by a guard, without a
    grip and without a large force."""
    if played.trip is None:
        assert played.outcome in GUARDED
    else:
        assert played.trip.cause in ("following_error", "force", "position")
        assert played.applied[-1].state == "latched"
        assert played.applied[-1].arms[0].voltage_V == 0.0
    assert max(truth.arms[0].force_mN for truth in played.truths) < HARD_MN


def test_a_reading_with_the_wrong_sign_trips_while_the_arm_is_free() -> None:
    played = play(changes={"sensor": {"direction": -1}})
    assert played.trip is not None
    assert applied_text(played.trip).startswith("following_error: the arm is at")
    assert played.applied[-1].state == "latched"
    assert max(truth.arms[0].force_mN for truth in played.truths) == 0.0


@pytest.mark.parametrize("factor", [0.1, 3.0, 6.0])
def test_a_job_with_a_wrong_gain_ends_with_bounded_force(factor: float) -> None:
    check_ended(play(changes={"simulation": {"piezo_um_per_V": factor * GAIN_UM_PER_V}}))


@pytest.mark.parametrize("factor", [3.0, 5.0])
@pytest.mark.parametrize("seq", [APPROACH, LOAD, HOLD], ids=["approach", "load", "hold"])
def test_a_job_with_far_more_hysteresis_than_the_model_ends_with_bounded_force(
    seq: int, factor: float
) -> None:
    check_ended(play(at(seq, "arm", "hysteresis", value=factor)))


@pytest.mark.parametrize("seq", [APPROACH, LOAD])
def test_a_job_whose_output_does_not_move_is_ended(seq: int) -> None:
    check_ended(play(at(seq, "output", "stuck")))


def test_a_held_part_is_kept_if_the_output_stops_moving() -> None:
    played = play(at(HOLD, "output", "stuck"))
    assert played.trip is not None
    assert played.trip.cause == "following_error"
    assert max(truth.arms[0].force_mN for truth in played.truths) < FORCE_MAX_MN


@pytest.mark.parametrize(
    ("target", "what", "value"),
    [("part", "lose", None), ("arm", "hysteresis", 2.0), ("arm", "stiffen", 3.0)],
)
@pytest.mark.parametrize("seq", [APPROACH, LOAD, HOLD], ids=["approach", "load", "hold"])
def test_a_fault_that_guards_handle_does_not_trip(
    seq: int, target: str, what: str, value: float | None
) -> None:
    more = {} if value is None else {"value": value}
    assert play(at(seq, target, what, **more)).trip is None


def test_a_weight_within_the_limits_trips_nothing() -> None:
    for seq in (APPROACH, LOAD, HOLD):
        assert play(at(seq, "weight", "hang", value=10.0)).trip is None
