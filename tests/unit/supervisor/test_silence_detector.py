"""A supervisor without messages queries before it trips: a working loop continues."""

import threading
from collections.abc import Callable
from time import sleep

import pytest

from pincette.config import RigFile
from pincette.core.faults import Mode
from pincette.core.messages import Position, Trip
from pincette.core.messages.arms import ArmPosition
from pincette_supervisor.process_load import GRID_S, ProcessLoad, share_words
from pincette_supervisor.rigs.rig_context import ActuatorTrip

from .canned import ANSWERING, PROGRAMS
from .harness import Harness

HOLD = 190
"""Tick at which the part is held."""
GRACE_S = 0.3
"""Shorter than the time for which a program that has returned may not reply, in s."""
DEAF_S = 2.5
"""Longer than the silence after which an actuator counts as silent, in s."""


@pytest.fixture
def desk(real_time: RigFile, open_harness: Callable[..., Harness]) -> Harness:
    desk = open_harness(real_time, guard_s=20.0)  # the guard is not what ends these jobs
    desk.bus.idle()
    return desk


def held(desk: Harness) -> str:
    """A grip that holds its part, without further messages."""
    over = threading.Event()

    def sensor() -> None:
        while not over.wait(0.02):
            desk.bus.publish(Position(0, 0, 0.0, (ArmPosition(0.01, valid=True),)))

    thread = threading.Thread(target=sensor)
    thread.start()
    try:
        return desk.playing_to(HOLD)
    finally:
        desk.bus.mode = Mode.ARMED
        over.set()
        thread.join()


def pass_time(desk: Harness, duration_s: float = DEAF_S) -> None:
    """Advance the clock by which the supervisor measures silence."""
    before = desk.observer.clock
    desk.observer.clock = lambda: before() + duration_s


def alarms(desk: Harness) -> list[str]:
    return [str(row["words"]) for row in desk.get("/alarms", cause="supervisor.deaf")["alarms"]]


def test_a_loop_that_answers_is_not_tripped_and_continues(desk: Harness) -> None:
    job = held(desk)
    pass_time(desk)
    desk.until(lambda: bool(alarms(desk)))
    assert desk.get(f"/jobs/{job}")["state"] == "running"
    assert desk.bus.trips == []
    (words,) = alarms(desk)
    assert "the loop continues" in words
    assert "this program was stalled for" in words
    desk.bus.play()
    assert desk.ended(job)["state"] == "succeeded"


def test_a_job_on_a_cut_line_is_ended_by_its_lease_only(desk: Harness) -> None:
    job = held(desk)
    desk.bus.silent.update(PROGRAMS)
    sleep(DEAF_S)
    assert desk.get(f"/jobs/{job}")["state"] == "running"
    desk.bus.silent.clear()
    desk.bus.play()
    assert desk.ended(job)["state"] == "succeeded"
    assert desk.bus.trips == []


def lose_router(desk: Harness) -> None:
    """Make all programs silent and remove their tokens, as when the router has ended."""
    for program in ANSWERING:
        desk.bus.kill(program)


def test_a_missing_router_ends_the_job_with_its_lease_without_a_trip(
    real_time: RigFile, open_harness: Callable[..., Harness], monkeypatch: pytest.MonkeyPatch
) -> None:
    """When the lease has ended, the controller stops the program, and a held part stays held."""
    safety = real_time.safety.model_copy(update={"lease_s": DEAF_S})
    desk = open_harness(real_time.model_copy(update={"safety": safety}))
    desk.bus.idle()
    stops: list[Trip] = []
    directly = ActuatorTrip("demo", desk.bus, stops.append)
    monkeypatch.setitem(vars(desk.manager.context), "trip", directly)
    job = held(desk)
    lose_router(desk)
    ended = desk.ended(job)
    assert (ended["state"], ended["ending"]["code"]) == ("failed", "silent")
    assert stops == []


@pytest.mark.parametrize("connected", [False, True])
def test_a_router_that_returns_stops_no_job_while_the_programs_link_to_it_again(
    desk: Harness, connected: bool
) -> None:
    """The programs link to it one after another, the actuator last.

    ``connected``: the actuator has linked to it too, but does not reply yet.
    """
    job = held(desk)
    lose_router(desk)
    pass_time(desk)
    for program in ANSWERING:
        if program != "actuator":
            desk.bus.revive(program)
    if connected:
        desk.bus.revive("actuator")
        desk.bus.silent.add("actuator")
    desk.bus.publish(Position(desk.bus.epoch, HOLD, 0.0, (ArmPosition(30.0, valid=True),)))
    sleep(GRACE_S)
    assert desk.get(f"/jobs/{job}")["state"] == "running"
    desk.bus.revive("actuator")
    desk.bus.play()
    assert desk.ended(job)["state"] == "succeeded"
    assert desk.bus.trips == []


def test_an_actuator_that_ends_after_the_router_returned_ends_the_job(desk: Harness) -> None:
    job = held(desk)
    lose_router(desk)
    for program in ANSWERING:
        desk.bus.revive(program)
    desk.bus.kill("actuator")
    ended = desk.ended(job)
    assert (ended["state"], ended["ending"]["code"]) == ("failed", "silent")
    assert "killed or hung: actuator" in ended["cause"]


def test_a_vanished_token_of_the_actuator_ends_the_job(desk: Harness) -> None:
    job = held(desk)
    desk.bus.kill("actuator")
    ended = desk.ended(job)
    assert (ended["state"], ended["ending"]["code"]) == ("failed", "silent")
    assert "killed or hung: actuator" in ended["cause"]


def test_a_silent_actuator_ends_the_job_while_others_are_received(desk: Harness) -> None:
    job = held(desk)
    desk.bus.silent.add("actuator")
    pass_time(desk)

    def stopped_while_the_sensor_is_heard() -> bool:
        desk.bus.publish(Position(desk.bus.epoch, HOLD, 0.0, (ArmPosition(30.0, valid=True),)))
        return desk.get(f"/jobs/{job}")["state"] != "running"

    desk.until(stopped_while_the_sensor_is_heard)
    assert "actuator: silent for more than 1 s" in desk.ended(job)["cause"]


def test_without_a_lease_a_cut_line_ends_the_job(
    real_time: RigFile, open_harness: Callable[..., Harness]
) -> None:
    safety = real_time.safety.model_copy(update={"lease_s": 0.0})
    desk = open_harness(real_time.model_copy(update={"safety": safety}))
    desk.bus.idle()
    job = held(desk)
    desk.bus.silent.update(PROGRAMS)
    pass_time(desk)
    assert "actuator: silent" in desk.ended(job)["cause"]


def test_a_stall_of_the_process_is_measured_from_its_activity() -> None:
    now_s = 100.0
    process_load = ProcessLoad(lambda: now_s)
    for _ in range(20):
        now_s += GRID_S
        process_load.sample()
    process_load.add("drawing", 0.7)
    now_s += 1.25
    stood_s, spent_s = process_load.within(2.0)
    assert stood_s == pytest.approx(1.25 - GRID_S)
    assert spent_s == {"bus": 0.0, "journal": 0.0, "drawing": 0.7}
    assert share_words(1.5, process_load).startswith("in the last 1.5 s this program was stalled")
    assert process_load.totals()[0] == pytest.approx(1.25 - GRID_S)
