"""Reported state of the rig: its programs, its latch, why a job cannot start."""

import threading
from collections.abc import Callable
from typing import cast
from unittest.mock import patch

import pytest
from msgspec.structs import replace

from pincette.config import RigFile
from pincette.core.faults import FaultCode, fault
from pincette.core.messages import Applied, Estimate, Message, Position
from pincette.core.messages.arms import ArmEstimate, ArmPosition
from pincette.core.topics import APPLIED, Request
from pincette_supervisor.program import PortInUseError, bind
from tests.support.arms import with_arm

from .harness import PATIENCE_S, Harness

NO_READING = fault(FaultCode.INSTRUMENT_SILENT, "no answer on the line")


def test_a_rig_that_was_switched_on_can_start(harness: Harness) -> None:
    rig = harness.get("/rigs/demo")
    assert rig["can_start"] is True
    assert rig["reasons"] == []
    assert rig["allowed_actions"] == ["start_job", "estop"]
    assert {program["name"] for program in rig["programs"]} == set(harness.bus.instances) - {"rig"}
    assert all(check["ok"] for check in rig["checks"])
    assert {"quantity": "force_max", "value": 40.0, "unit": "mN"} in rig["limits"]


def test_the_newest_voltage_is_one_that_the_output_has_confirmed(harness: Harness) -> None:
    harness.bus.idle()
    assert harness.get("/rigs/demo")["newest"]["voltage_V"] == 0.0
    applied = cast(Applied, harness.bus.latest(APPLIED))
    harness.bus.publish(replace(applied, unconfirmed=True))
    assert harness.get("/rigs/demo")["newest"]["voltage_V"] is None


def test_an_invalid_zero_is_reported_without_a_force(harness: Harness) -> None:
    harness.bus.idle()
    arm = ArmEstimate(31.0, -1.23, 0.48, 0.0, 4.0, None, 1.0, 0)
    estimate = Estimate(1, 5, 4, tripped=False, degraded=False, arms=(arm,), valid=True)
    harness.bus.publish(estimate)
    newest = harness.get("/rigs/demo")["newest"]
    assert (newest["force_mN"], newest["zero_invalid"]) == (-1.23, False)
    invalid = fault(FaultCode.ZERO_INVALID, pull_mN=1.23, uncertainty_mN=0.48)
    harness.bus.findings["estimator"] = (invalid,)
    harness.bus.publish(with_arm(estimate, zero_age_s=None, zero_refusal=invalid))
    newest = harness.get("/rigs/demo")["newest"]
    stated = [newest[name] for name in ("force_mN", "force_uncertainty_mN", "zero_age_s")]
    assert (stated, newest["zero_invalid"]) == ([None] * 3, True)

    def check() -> tuple[bool, float | None, float | None]:
        checks = harness.get("/rigs/demo")["checks"]
        found = next(one for one in checks if one["name"] == "estimator.zero")
        return found["ok"], found["value"], found["limit"]

    harness.until(lambda: check() == (False, 1.23, 0.48))
    programs = harness.get("/rigs/demo")["programs"]
    estimator = next(one for one in programs if one["name"] == "estimator")
    assert [one["code"] for one in estimator["faults"]] == ["zero_invalid"]


def test_each_program_reports_its_timing_statistics(harness: Harness) -> None:
    harness.bus.silent.add("controller")
    timing = harness.get("/rigs/demo/timing")
    assert [one["program"] for one in timing["programs"]] == ["sensor", "estimator", "actuator"]
    late = {"count": 1, "p50_s": 1e-3, "p99_s": 1e-3, "p999_s": 1e-3, "max_s": 1e-3}
    assert timing["programs"][0]["lateness"] == late
    assert timing["programs"][0]["age"]["p50_s"] is None
    assert list(timing["silent"]) == ["controller"]
    assert "no program answers controller/timing" in timing["silent"]["controller"]


def test_the_boot_latch_is_cleared_once(harness: Harness) -> None:
    for _ in range(2):
        assert harness.ended(harness.grip()["id"])["state"] == "succeeded"
    assert harness.bus.asked.count("actuator/reset") == 1


def test_an_actuator_that_does_not_answer_cannot_be_reset(
    harness: Harness,
) -> None:
    harness.bus.idle()
    harness.bus.silent.add("actuator")
    harness.health.refresh(force=True)
    assert harness.get("/rigs/demo")["reasons"][0].startswith("actuator: no program answers")
    refused = harness.post("/jobs", {"kind": "grip"})
    assert (refused.status_code, refused.json()["reasons"]) == (
        503,
        ["actuator: no program answers actuator/status within 0.7 s"],
    )
    harness.bus.silent.discard("actuator")
    assert harness.ended(harness.grip()["id"])["state"] == "succeeded"


def test_an_actuator_that_was_started_again_needs_a_person(harness: Harness) -> None:
    assert harness.ended(harness.grip()["id"])["state"] == "succeeded"
    assert harness.get("/rigs/demo")["latch"]["state"] == "idle"
    harness.bus.instances["actuator"] = 2
    harness.bus.latch = "boot"
    response = harness.post("/jobs", {"kind": "grip"})
    assert response.status_code == 409, "although the previous program has just replied"
    assert response.json()["cause"] == "restart"
    assert harness.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
    assert harness.ended(harness.grip()["id"])["state"] == "succeeded"


def test_earlier_messages_of_a_restarted_program_are_not_shown(harness: Harness) -> None:
    assert harness.ended(harness.grip()["id"])["state"] == "succeeded"
    assert harness.get("/rigs/demo")["can_start"] is True
    harness.bus.kill("actuator")
    assert harness.get("/rigs/demo")["can_start"] is False
    harness.bus.instances["actuator"] = 2
    harness.bus.latch = "boot"
    harness.bus.revive("actuator")
    assert harness.get("/rigs/demo")["latch"]["cause"] == "restart"


def test_a_reply_that_arrives_after_a_later_one_is_dropped(harness: Harness) -> None:
    call, requested, go_on = harness.bus.call, threading.Event(), threading.Event()

    def slow(question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        answer = call(question, request, timeout_s)
        if question.service == "recorder" and not requested.is_set():
            requested.set()
            assert go_on.wait(PATIENCE_S)
        return answer

    with patch.object(harness.bus, "call", slow):
        earlier = threading.Thread(target=harness.health.refresh, kwargs={"force": True})
        earlier.start()
        assert requested.wait(PATIENCE_S)
        harness.bus.instances["actuator"] = 2
        harness.health.refresh(force=True)
        go_on.set()
        earlier.join(PATIENCE_S)
    actuator = harness.health.status("actuator")
    assert actuator is not None
    assert actuator.instance == 2


def test_an_emergency_stop_is_cleared_by_an_acknowledged_reset_only(harness: Harness) -> None:
    assert harness.post("/rigs/demo/estop").json()["cause"] == "estop"
    rig = harness.get("/rigs/demo")
    assert rig["latch"]["cause"] == "estop"
    assert "reset" in rig["allowed_actions"]
    assert rig["can_start"] is False
    refused = harness.post("/jobs", {"kind": "grip", "autostart": True})
    assert refused.status_code == 409
    assert refused.json()["type"] == "urn:pincette:problem:estop-engaged"
    assert "acknowledge" in refused.json()["detail"]
    assert harness.post("/rigs/demo/reset", {"acknowledge": False}).status_code == 422
    assert harness.post("/rigs/demo/reset").status_code == 422
    assert harness.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
    assert harness.get("/rigs/demo")["can_start"] is True


def test_the_requesters_of_stop_and_reset_are_reported(harness: Harness) -> None:
    who = {"X-Operator": "Ada"}
    assert harness.call("POST", "/api/v1/rigs/demo/estop", headers=who).status_code == 200
    harness.until(lambda: bool(harness.told("alarm")))
    reset = {"json": {"acknowledge": True}, "headers": who}
    assert harness.call("POST", "/api/v1/rigs/demo/reset", **reset).status_code == 200
    (alarm, events) = harness.told("alarm", "rig")
    assert (alarm.body["cause"], alarm.body["by"]) == ("estop", "Ada")
    assert (events.body["reset"], events.body["by"]) == ("estop", "Ada")


def test_an_unconfirmed_emergency_stop_states_a_remedy(harness: Harness) -> None:
    harness.bus.silent.add("actuator")
    response = harness.post("/rigs/demo/estop")
    assert response.status_code == 503
    assert "switch the amplifier off" in response.json()["detail"]


def test_a_missing_program_is_a_reason_not_to_start(harness: Harness) -> None:
    harness.bus.kill("estimator")
    response = harness.post("/jobs", {"kind": "grip"})
    assert response.status_code == 503
    (reason,) = response.json()["reasons"]
    assert reason.startswith("estimator: no program answers")
    assert harness.call("GET", "/readyz").status_code == 503
    program = next(p for p in harness.get("/rigs/demo")["programs"] if p["name"] == "estimator")
    assert program["alive"] is False


def test_a_program_with_another_rig_file_is_named(harness: Harness) -> None:
    harness.bus.digests["sensor"] = "0123456789abcdef"
    (reason,) = harness.post("/jobs", {"kind": "grip"}).json()["reasons"]
    assert reason.startswith("sensor: runs with rig file 0123456789abcdef")


def test_in_real_time_a_sample_is_required(
    real_time: RigFile, open_harness: Callable[..., Harness]
) -> None:
    harness = open_harness(real_time)
    harness.observer.clock = lambda: 100.0
    assert harness.get("/rigs/demo")["reasons"] == ["sensor: no sample has come yet"]
    harness.bus.idle()
    assert harness.get("/rigs/demo")["can_start"] is True
    harness.bus.publish(
        with_arm(
            Position(0, 1, 0.02, (ArmPosition(0.0),)),
            fault=NO_READING,
        )
    )
    assert harness.get("/rigs/demo")["can_start"] is True, (
        "one invalid position must not prevent a start"
    )
    harness.observer.clock = lambda: 100.21
    harness.bus.publish(
        with_arm(
            Position(0, 2, 0.04, (ArmPosition(0.0),)),
            fault=NO_READING,
        )
    )
    (reason,) = harness.get("/rigs/demo")["reasons"]
    assert reason == "sensor: reads no position: no answer on the line"


def test_a_sensor_that_falls_silent_is_a_reason_with_its_age_and_limit(
    real_time: RigFile, open_harness: Callable[..., Harness]
) -> None:
    harness = open_harness(real_time)
    harness.observer.clock = lambda: 100.0
    harness.bus.idle()
    harness.observer.clock = lambda: 100.62
    (reason,) = harness.get("/rigs/demo")["reasons"]
    assert reason == "sensor: silent for 620 ms, limit 200 ms"


def test_the_latch_of_an_earlier_supervisor_is_not_cleared_automatically(
    harness: Harness, rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    harness.health.refresh(force=True)
    second = open_harness(rig_file)
    second.health.refresh(force=True)
    assert second.store.get_note("actuator_met: demo") == "1"
    job = second.ended(second.grip()["id"])
    assert job["state"] == "failed"
    assert "reset it first" in job["cause"]


@pytest.mark.parametrize(
    ("replaces", "state"), [(1, "switched_on"), (7, "latched"), (None, "latched")]
)
def test_a_rig_that_was_only_switched_on_and_off_needs_no_person(
    replaces: int | None,
    state: str,
    harness: Harness,
    rig_file: RigFile,
    open_harness: Callable[..., Harness],
) -> None:
    """The actuator states how the previous one ended; any other may have died with a part held."""
    harness.health.refresh(force=True)
    second = open_harness(rig_file)
    second.bus.instances["actuator"], second.bus.replaces = 2, replaces
    second.bus.idle()
    second.health.refresh(force=True)
    assert second.get("/rigs/demo")["latch"]["state"] == state


def test_probes_report_alive_ready_and_version(harness: Harness) -> None:
    assert harness.call("GET", "/livez").json()["status"] == "alive"
    assert harness.call("GET", "/readyz").json()["status"] == "ready"
    assert harness.call("GET", "/version").json()["rig"] == "demo"


def test_a_port_in_use_is_named_with_a_remedy() -> None:
    taken = bind("127.0.0.1", 0)
    taken.listen()
    port = taken.getsockname()[1]
    with pytest.raises(PortInUseError, match=rf"127\.0\.0\.1:{port} is in use.*\[supervisor\]"):
        bind("127.0.0.1", port)
    taken.close()


def test_instruments_that_do_not_fit_into_the_period_are_a_reason_with_the_sum(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    fast = rig_file.rig.model_copy(update={"period_s": 0.01})
    harness = open_harness(rig_file.model_copy(update={"rig": fast}))
    assert harness.get("/rigs/demo")["can_start"] is False
    response = harness.post("/jobs", {"kind": "calibrate", "calibration": "noise"})
    assert response.status_code == 503
    (reason,) = response.json()["reasons"]
    assert reason.startswith("the instruments are too slow: ")
    for words in ("output response 10.0", "computing 2.0", "above the control period of 10 ms"):
        assert words in reason
