"""Named checks: what is checked, by probes and at the rig, with value, limit and text."""

from collections.abc import Callable
from typing import Any

import pytest

from pincette.config import RigFile
from pincette.core.topics import LOOP

from .canned import IN_HOLD
from .full_disk import FULL, full_disk
from .harness import Harness


def checks(harness: Harness) -> dict[str, dict[str, Any]]:
    return {check["name"]: check for check in harness.get("/rigs/demo")["checks"]}


def readiness(harness: Harness, status: int) -> dict[str, Any]:
    response = harness.call("GET", "/readyz")
    assert response.status_code == status
    return response.json()


def test_a_complete_rig_is_ready(harness: Harness) -> None:
    found = readiness(harness, 200)
    assert (found["status"], found["reasons"]) == ("ready", [])
    assert [check["name"] for check in found["checks"]] == ["store"]
    names = {check["name"] for check in found["rigs"]["demo"]}
    assert names >= {f"{name}.answer" for name in (*LOOP, "recorder")}
    assert names >= {"actuator.latch", "disk", "recorder.lost", "lease", "model.due"}
    assert all(check["ok"] for check in found["rigs"]["demo"])
    assert all(check["words"] for check in found["rigs"]["demo"])
    assert checks(harness).keys() == names


def test_liveness_reports_the_lag_of_the_event_loop(harness: Harness) -> None:
    found = harness.call("GET", "/livez").json()
    assert found["status"] == "alive"
    (check,) = found["checks"]
    assert (check["name"], check["ok"], check["unit"]) == ("event_loop", True, "s")
    assert 0.0 <= check["value"] < check["limit"]


@pytest.mark.parametrize("name", [*LOOP, "recorder"])
def test_a_program_that_does_not_answer_is_named(harness: Harness, name: str) -> None:
    harness.bus.silent.add(name)
    found = readiness(harness, 503)
    failing = [check for check in found["rigs"]["demo"] if not check["ok"] and check["needed"]]
    assert [check["name"] for check in failing] == [f"{name}.answer"]
    assert found["reasons"] == [f"demo: {failing[0]['words']}"]
    assert failing[0]["words"].startswith(f"{name}: no program answers {name}/status within 0.7 s")


def test_another_rig_file_is_reported_with_both_digests(harness: Harness) -> None:
    harness.bus.digests["estimator"] = "another"
    (check,) = [one for one in checks(harness).values() if not one["ok"]]
    assert (check["name"], check["value"]) == ("estimator.answer", "another")
    assert check["limit"] == harness.get("/rigs/demo")["digest"]


def test_a_silent_sensor_is_reported_once_with_its_age_and_limit(
    real_time: RigFile, open_harness: Callable[..., Harness]
) -> None:
    harness = open_harness(real_time)
    heard_s = harness.observer.clock()
    harness.observer.clock = lambda: heard_s
    harness.bus.idle()
    assert checks(harness)["sensor.age"]["ok"]
    harness.observer.clock = lambda: heard_s + 0.412
    check = checks(harness)["sensor.age"]
    assert (check["ok"], check["limit"], check["unit"]) == (False, 0.2, "s")
    assert check["value"] == pytest.approx(0.412)
    assert check["words"] == "sensor: silent for 412 ms, limit 200 ms"
    assert readiness(harness, 503)["reasons"] == [f"demo: {checks(harness)['sensor.age']['words']}"]


def test_a_latched_actuator_is_ready_and_waits_for_a_person(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD)
    harness.bus.trip("device: no answer")
    harness.ended(job)
    found = readiness(harness, 200)
    (latch,) = [check for check in found["rigs"]["demo"] if check["name"] == "actuator.latch"]
    assert not latch["ok"]
    assert not latch["needed"]


def test_a_journal_that_cannot_be_written_refuses_jobs_until_it_can(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    harness.health.refresh()
    with full_disk(monkeypatch):
        assert not harness.store.probe()
        found = readiness(harness, 503)
        assert found["reasons"] == [f"store: {FULL}"]
        assert found["checks"][0]["value"] == "failed"
        rig = harness.get("/rigs/demo")
        assert not rig["can_start"]
        assert f"store: {FULL}" in rig["reasons"]
        harness.manager.alarm_monitor.poll()
        readiness(harness, 503)
    harness.manager.alarm_monitor.poll()
    assert readiness(harness, 200)["reasons"] == []
    causes = [row["cause"] for row in harness.get("/alarms")["alarms"]]
    assert causes == ["store"]


def test_refused_messages_of_a_program_and_of_the_supervisor_are_shown(harness: Harness) -> None:
    assert checks(harness)["bus.refused"]["ok"]
    harness.bus.refused.note("pincette/v2/demo/position", "Position.arms.x_um = nan µm: not finite")
    check = checks(harness)["bus.refused"]
    assert (check["ok"], check["needed"], check["value"]) == (False, False, 1)
    assert "Position.arms.x_um" in check["words"]
    counted = harness.call("GET", "/metrics").text
    assert 'pincette_dropped_total{kind="refused",rig="demo",service="supervisor"} 1.0' in counted
