"""The alarm log: one row for as long as an alarm is open, and the same texts everywhere."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pincette.config import RigFile
from pincette.control.record import replace
from pincette.core.faults import Cause, FaultCode, Mode, fault
from pincette_supervisor.alarms import TripReason
from pincette_supervisor.journal import events
from pincette_supervisor.journal.events import AlarmRepository, AlarmRow
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.watch import AFTER_A_LOSS, IDLE_S

from . import samples
from .canned import IN_HOLD
from .harness import Harness

AT, LATER = "2026-03-01T12:00:00.000Z", "2026-03-01T12:00:09.000Z"
DISK = AlarmRow("demo", "disk", "disk: 5 MB free, limit 200 MB", AT, "warning", "condition")


@pytest.fixture
def book(store: Store) -> AlarmRepository:
    return AlarmRepository(store)


def test_repeated_alarms_are_counted_in_one_row(book: AlarmRepository) -> None:
    first = book.add(DISK)
    later = replace(DISK, words="disk: 4 MB free, limit 200 MB", raised_at=LATER)
    again = [book.add(later) for _ in range(99)]
    (row,) = book.newest(500)
    assert (row.number, row.count, row.raised_at, row.last_at) == (first.number, 100, AT, LATER)
    assert row.words == "disk: 4 MB free, limit 200 MB"
    assert again[-1] == row


def test_an_alarm_is_open_until_it_has_ended_and_was_acknowledged(book: AlarmRepository) -> None:
    number = book.add(DISK).number
    book.acknowledge(number, AT, "Ada")
    assert book.count_open("demo") == 1
    assert book.add(DISK).number == number
    book.clear("demo", LATER, cause="disk", clears="condition")
    assert book.count_open() == 0
    assert book.add(DISK).number > number


def test_an_unacknowledged_alarm_that_returns_uses_its_row_again(book: AlarmRepository) -> None:
    number = book.add(DISK).number
    book.clear("demo", LATER, cause="disk", clears="condition")
    assert book.standing("demo") == []
    back = book.add(DISK)
    assert (back.number, back.cleared_at, back.count) == (number, None, 2)


def test_a_momentary_alarm_is_closed_by_its_acknowledgement(book: AlarmRepository) -> None:
    moment = replace(DISK, cause="recorder.lost", clears="acknowledge")
    row = book.add(moment)
    assert row.cleared_at == AT
    assert book.count_open() == 1
    book.acknowledge(row.number, LATER, "Ada")
    assert book.count_open() == 0


def test_each_trip_belongs_to_its_job_and_ends_with_the_reset(book: AlarmRepository) -> None:
    trip = replace(DISK, cause="device", severity="alarm", clears="reset", job="a")
    one, other = book.add(trip), book.add(replace(trip, job="b"))
    assert one.number != other.number
    assert book.clear("demo", LATER, cause="disk", clears="condition") == []
    assert [row.number for row in book.clear("demo", LATER, clears="reset")] == [1, 2]


def test_the_first_acknowledgement_is_kept(book: AlarmRepository) -> None:
    number = book.add(DISK).number
    book.acknowledge(number, AT, "Ada")
    row = book.acknowledge(number, LATER, "Bob")
    assert row is not None
    assert (row.acknowledged_at, row.acknowledged_by) == (AT, "Ada")
    assert book.acknowledge(99, LATER, "Bob") is None


def test_the_number_of_stored_alarms_is_limited(
    book: AlarmRepository, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(events, "ALARMS_KEPT", 20)
    for place in range(220):
        book.add(replace(DISK, cause=f"cause {place}"))
    rows = book.newest(500)
    assert rows[0].cause == "cause 219"
    assert 20 <= len(rows) <= 20 + events.ALARMS_SWEEP


def alarms(harness: Harness, **query: Any) -> list[dict[str, Any]]:
    return harness.get("/alarms", **query)["alarms"]


def test_a_trip_is_reported_in_the_same_words_by_job_rig_alarm_and_event(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD)
    harness.bus.trip("device: no answer")
    ended = harness.ended(job)
    (row,) = alarms(harness)
    assert (row["job"], row["cause"], row["severity"], row["clears"], row["count"]) == (
        job,
        "device",
        "alarm",
        "reset",
        1,
    )
    assert row["words"] == "device: no answer"
    assert row["words"] in ended["cause"]
    rig = harness.get("/rigs/demo")
    assert rig["latch"]["words"] == row["words"]
    assert any(row["words"] in reason for reason in rig["reasons"])
    (latch,) = [check for check in rig["checks"] if check["name"] == "actuator.latch"]
    assert not latch["ok"]
    assert row["words"] in latch["words"]
    (event,) = harness.told("alarm")
    assert event.body["words"] == row["words"]
    assert event.body["alarm"]["id"] == row["id"]
    # Seen from outside the job, it is the same trip.
    harness.manager.alarm_monitor.poll()
    assert len(alarms(harness)) == 1
    assert alarms(harness)[0]["count"] == 1


def test_a_reset_clears_the_trip_alarm_and_a_person_acknowledges_the_alarm(
    harness: Harness,
) -> None:
    job = harness.playing_to(IN_HOLD)
    harness.bus.trip("device: no answer")
    harness.ended(job)
    assert harness.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
    (row,) = alarms(harness, open="true")
    assert row["cleared_at"] is not None
    acted = harness.post(f"/alarms/{row['id']}/actions", {"type": "acknowledge"})
    assert acted.status_code == 200
    assert acted.json()["acknowledged_by"]
    assert not acted.json()["open"]
    assert alarms(harness, open="true") == []
    assert [one["id"] for one in alarms(harness)] == [row["id"]]
    assert [row.body["did"] for row in harness.told("alarm")] == ["raised", "acknowledged"]
    again = harness.post(f"/alarms/{row['id']}/actions", {"type": "acknowledge"})
    assert again.json() == acted.json()


def test_acknowledging_an_alarm_does_not_reset_the_rig(harness: Harness) -> None:
    harness.bus.trip("estop")
    harness.manager.alarm_monitor.poll()
    (row,) = alarms(harness)
    harness.post(f"/alarms/{row['id']}/actions", {"type": "acknowledge"})
    assert harness.bus.latch == "estop"
    (row,) = alarms(harness, open="true")
    assert row["cleared_at"] is None


def test_the_text_of_an_emergency_stop_names_its_requester(harness: Harness) -> None:
    harness.call("POST", "/api/v1/rigs/demo/estop", headers={"X-Operator": "Ada"})
    harness.until(lambda: bool(alarms(harness)))
    (row,) = alarms(harness)
    assert (row["cause"], row["job"]) == ("estop", None)
    assert row["words"] == "estop: an emergency stop was requested, by Ada"


def test_the_first_of_several_requests_names_an_emergency_stop(harness: Harness) -> None:
    book, reason = harness.manager.context.alarms, TripReason(Cause.ESTOP)
    for names in (["Ada", "192.0.2.7"], ["Bob"]):
        for name in names:
            book.expect(Cause.ESTOP, name)
        for _ in names:
            book.raise_trip(reason, "estop", None)
        harness.until(lambda by=names[0]: alarms(harness)[0]["words"] == f"estop, by {by}")
        book.expect(Cause.ESTOP, "late")
        book.raise_trip(reason, "estop", None)
        book.reset()


def test_the_alarm_of_a_dead_program_lasts_until_it_returns(harness: Harness) -> None:
    watch = harness.manager.alarm_monitor
    watch.poll()
    assert alarms(harness) == []
    harness.bus.kill("estimator")
    for _ in range(5):
        watch.poll()
    (row,) = alarms(harness)
    assert (row["cause"], row["count"], row["cleared_at"]) == ("program.estimator", 1, None)
    assert row["words"] == "estimator has disappeared: killed, hung or disconnected"
    harness.bus.revive("estimator")
    watch.poll()
    (row,) = alarms(harness)
    assert row["cleared_at"] is not None
    assert [one.body["did"] for one in harness.told("alarm")] == ["raised", "cleared"]


def test_a_second_controller_raises_a_single_alarm_however_many_commands_it_sends(
    harness: Harness,
) -> None:
    watch = harness.manager.alarm_monitor
    stranger = fault(FaultCode.OTHER_OWNER, owner=9, armed_owner=5)
    harness.bus.mode, harness.bus.findings["actuator"] = Mode.ARMED, (stranger,)
    applied = samples.grip(1)[0].applied
    for refused in range(0, 500, 10):
        harness.bus.publish(replace(applied, refused=refused))
        watch.poll()
    (row,) = alarms(harness)
    assert (row["cause"], row["clears"]) == ("controller.second", "acknowledge")
    assert "command of owner 9, armed for 5" in row["words"]


def test_occasional_late_commands_raise_no_alarm(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    now_s = 0.0
    harness = open_harness(rig_file, clock=lambda: now_s)
    applied = samples.grip(1)[0].applied
    for refused in range(50):
        now_s += 1.0
        harness.bus.publish(replace(applied, refused=refused))
        harness.manager.alarm_monitor.poll()
    assert alarms(harness) == []


def test_the_alarm_of_a_stuck_sensor_lasts_while_it_is_stuck(harness: Harness) -> None:
    watch = harness.manager.alarm_monitor
    estimate = samples.grip(1)[0].estimate
    words = "sensor stuck: 12.000 µm in 10 samples while the voltage moved"
    stuck = fault(FaultCode.SENSOR_STUCK, x_um=12.0, samples=10)
    harness.bus.publish(replace(estimate, valid=False, fault=stuck))
    watch.poll()
    watch.poll()
    (row,) = alarms(harness)
    assert (row["cause"], row["words"], row["count"]) == ("sensor.stuck", words, 1)
    harness.bus.publish(estimate)
    watch.poll()
    assert alarms(harness)[0]["cleared_at"] is not None


def test_an_almost_full_disk_is_reported_early(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = harness.manager.alarm_monitor
    watch.poll()
    assert alarms(harness) == []

    def low(_folder: Path) -> float:
        return 12.0

    monkeypatch.setattr("pincette_supervisor.watch.free_space_MB", low)
    watch.poll()
    (row,) = alarms(harness)
    assert (row["cause"], row["severity"]) == ("disk", "warning")
    assert row["words"].endswith("12 MB free, limit 200 MB")


def test_alarms_that_could_not_be_written_are_written_later_with_their_time(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    add = AlarmRepository.add

    def full(_book: AlarmRepository, _one: AlarmRow) -> None:
        raise StoreError("database or disk is full")

    monkeypatch.setattr(AlarmRepository, "add", full)
    harness.bus.kill("recorder")
    watch = harness.manager.alarm_monitor
    watch.poll()
    assert alarms(harness) == []
    monkeypatch.setattr(AlarmRepository, "add", add)
    harness.bus.revive("recorder")
    watch.poll()
    (row,) = alarms(harness)
    assert row["cause"] == "program.recorder"
    assert row["cleared_at"] is not None
    assert row["raised_at"] <= row["cleared_at"]


def test_the_next_supervisor_knows_the_open_alarms(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    before = open_harness(rig_file)
    before.bus.kill("sensor")
    before.bus.trip("device: no answer")
    before.manager.alarm_monitor.poll()
    after = open_harness(rig_file)
    after.bus.trip("device: no answer")
    after.manager.alarm_monitor.poll()
    rows = {row["cause"]: row for row in alarms(after)}
    assert {cause: row["count"] for cause, row in rows.items()} == {
        "program.sensor": 1,
        "device": 1,
    }
    assert rows["program.sensor"]["cleared_at"] is not None
    assert rows["device"]["cleared_at"] is None


def test_alarms_are_listed_page_by_page_and_filtered(harness: Harness) -> None:
    book = AlarmRepository(harness.store)
    for place in range(5):
        book.add(replace(DISK, cause=f"cause {place}", rig="demo" if place % 2 else "other"))
    first = harness.get("/alarms", limit=2)
    assert [row["cause"] for row in first["alarms"]] == ["cause 4", "cause 3"]
    assert first["open"] == 5
    second = harness.get("/alarms", limit=2, before=first["next"])
    assert [row["cause"] for row in second["alarms"]] == ["cause 2", "cause 1"]
    assert {row["rig"] for row in alarms(harness, rig="other")} == {"other"}
    assert alarms(harness, cause="cause 2")[0]["id"] == 3
    assert alarms(harness, severity="alarm") == []
    assert harness.get("/alarms/3")["cause"] == "cause 2"
    assert harness.call("GET", "/api/v1/alarms/99").status_code == 404
    assert harness.post("/alarms/99/actions", {"type": "acknowledge"}).status_code == 404
    assert harness.post("/alarms/3/actions", {"type": "forget"}).status_code == 422


def test_lost_messages_are_reported_with_the_record_that_lacks_them_and_what_to_do(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    now_s = 0.0
    real = rig_file.model_copy(update={"rig": rig_file.rig.model_copy(update={"time": "real"})})
    harness = open_harness(real, clock=lambda: now_s)
    watch = harness.manager.alarm_monitor
    harness.health.clock = lambda: now_s
    lack = "idle; the record of job j-1 lacks messages: 3 of position never came"
    harness.bus.findings["recorder"] = (fault(FaultCode.RECORDER_STATE, lack, messages_lost=3.0),)

    def lost() -> list[dict[str, Any]]:
        nonlocal now_s
        now_s += 5.0
        watch.poll()
        return alarms(harness, cause="recorder.lost")

    harness.until(lambda: lost() == [] and harness.health.status("recorder") is not None)
    harness.bus.missed["recorder"] = 3
    harness.until(lambda: bool(lost()))
    (row,) = lost()
    assert row["words"] == f"recorder lost 3 messages: {lack}; 3 messages lost; {AFTER_A_LOSS}"


def test_a_rig_without_a_job_samples_slowly_after_a_while(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    now_s = 0.0
    real = rig_file.model_copy(update={"rig": rig_file.rig.model_copy(update={"time": "real"})})
    harness = open_harness(real, clock=lambda: now_s)
    watch, health = harness.manager.alarm_monitor, harness.health
    health.clock = lambda: now_s
    harness.bus.mode = Mode.IDLE
    harness.bus.idle()

    def polls(for_s: float) -> int:
        nonlocal now_s
        until_s = now_s + for_s
        while now_s < until_s:
            now_s += 1.0
            watch.poll()
        return harness.bus.asked.count("sensor/idle")

    often_s = health.sensor_limit_s()
    assert polls(0.8 * IDLE_S) == 0
    harness.bus.mode = Mode.ARMED
    assert polls(2.0 * IDLE_S) == 0
    harness.bus.mode = Mode.IDLE
    assert polls(0.8 * IDLE_S) == 0
    assert polls(5.0 * IDLE_S) == 1, "asked once"
    assert health.sensor_limit_s() > often_s
    harness.bus.epoch += 1
    harness.bus.idle()
    assert health.sensor_limit_s() == often_s
    assert polls(2.0 * IDLE_S) == 2, "of each epoch"
