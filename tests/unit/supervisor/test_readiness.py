"""Named checks: what is looked at, in probes and at the rig, with value, limit and words."""

from collections.abc import Callable
from typing import Any

import pytest

from pincette.config import RigFile
from pincette.topics import LOOP

from .canned import IN_HOLD
from .full_disk import FULL, full_disk
from .rig import Desk


def checks(desk: Desk) -> dict[str, dict[str, Any]]:
    return {check["name"]: check for check in desk.get("/rigs/demo")["checks"]}


def readiness(desk: Desk, status: int) -> dict[str, Any]:
    response = desk.call("GET", "/readyz")
    assert response.status_code == status
    return response.json()


def test_a_rig_that_is_whole_is_ready(desk: Desk) -> None:
    found = readiness(desk, 200)
    assert (found["status"], found["reasons"]) == ("ready", [])
    assert [check["name"] for check in found["checks"]] == ["store"]
    names = {check["name"] for check in found["rigs"]["demo"]}
    assert names >= {f"{name}.answer" for name in (*LOOP, "recorder")}
    assert names >= {"actuator.latch", "disk", "recorder.lost", "lease", "model.due"}
    assert all(check["ok"] for check in found["rigs"]["demo"])
    assert all(check["words"] for check in found["rigs"]["demo"])
    assert checks(desk).keys() == names


def test_alive_says_how_long_a_turn_takes(desk: Desk) -> None:
    found = desk.call("GET", "/livez").json()
    assert found["status"] == "alive"
    (check,) = found["checks"]
    assert (check["name"], check["ok"], check["unit"]) == ("event_loop", True, "s")
    assert 0.0 <= check["value"] < check["limit"]


@pytest.mark.parametrize("name", [*LOOP, "recorder"])
def test_a_program_that_does_not_answer_is_named(desk: Desk, name: str) -> None:
    desk.bus.silent.add(name)
    found = readiness(desk, 503)
    failing = [check for check in found["rigs"]["demo"] if not check["ok"] and check["needed"]]
    assert [check["name"] for check in failing] == [f"{name}.answer"]
    assert found["reasons"] == [f"demo: {failing[0]['words']}"]
    assert failing[0]["words"].startswith(f"{name}: nobody answers {name}/status within 0.7 s")


def test_another_rig_file_is_told_with_both_digests(desk: Desk) -> None:
    desk.bus.digests["estimator"] = "another"
    (check,) = [one for one in checks(desk).values() if not one["ok"]]
    assert (check["name"], check["value"]) == ("estimator.answer", "another")
    assert check["limit"] == desk.get("/rigs/demo")["digest"]


def test_a_silent_sensor_is_told_once_with_its_age_and_limit(
    real_time: RigFile, open_desk: Callable[..., Desk]
) -> None:
    desk = open_desk(real_time)
    desk.bus.idle()
    assert checks(desk)["sensor.age"]["ok"]
    now_s = desk.observer.clock()
    desk.observer.clock = lambda: now_s + 0.412
    check = checks(desk)["sensor.age"]
    assert (check["ok"], check["limit"], check["unit"]) == (False, 0.2, "s")
    assert check["value"] == pytest.approx(0.412, abs=0.2)
    assert check["words"].startswith("sensor: silent for ")
    assert check["words"].endswith(" ms, limit 200 ms")
    assert readiness(desk, 503)["reasons"] == [f"demo: {checks(desk)['sensor.age']['words']}"]


def test_a_latched_actuator_is_ready_and_waits_for_a_person(desk: Desk) -> None:
    job = desk.playing_to(IN_HOLD)
    desk.bus.trip("device: no answer")
    desk.ended(job)
    found = readiness(desk, 200)
    (latch,) = [check for check in found["rigs"]["demo"] if check["name"] == "actuator.latch"]
    assert not latch["ok"]
    assert not latch["needed"]


def test_a_journal_that_cannot_be_written_refuses_jobs_until_it_can(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    desk.health.refresh()
    with full_disk(monkeypatch):
        assert not desk.store.probe()
        found = readiness(desk, 503)
        assert found["reasons"] == [f"store: {FULL}"]
        assert found["checks"][0]["value"] == "failed"
        rig = desk.get("/rigs/demo")
        assert not rig["can_start"]
        assert f"store: {FULL}" in rig["reasons"]
        desk.conductor.alarm_watch.look()
        readiness(desk, 503)
    desk.conductor.alarm_watch.look()
    assert readiness(desk, 200)["reasons"] == []
    causes = [row["cause"] for row in desk.get("/alarms")["alarms"]]
    assert causes == ["store"]
