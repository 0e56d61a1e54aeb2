"""Calibrations from request to the model in use, on a rig that plays prepared samples."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pincette.config import RigFile
from pincette.records import folder
from pincette_supervisor.jobs import bring_up

from . import samples
from .harness import Harness
from .samples import Tick

STEPS = (0.0, 5.0, 10.0, 5.0, 0.0)
TRUE_UM_PER_MN = 0.44
STEP_TICKS = samples.HANG_TICKS + 60


def at_rest(noise_um: float = 0.03) -> Callable[[list[Tick]], list[Tick]]:
    return lambda ticks: samples.rest(ticks[0].position.epoch, noise_um)


def proposal(harness: Harness, noise_um: float = 0.03) -> str:
    """A calibration of the noise that has succeeded."""
    harness.bus.edit = at_rest(noise_um)
    job = harness.calibrated()
    assert (job["state"], job["cause"]) == ("succeeded", "")
    return str(job["id"])


def decide(harness: Harness, name: str, action: str) -> Any:
    return harness.post(f"/calibrations/{name}/actions", {"type": action})


def in_use(harness: Harness, quantity: str) -> dict[str, Any]:
    model = harness.get("/rigs/demo/model")
    return next(item for item in model["quantities"] if item["quantity"] == quantity)


@pytest.mark.usefixtures("drawn")
def test_a_calibration_proposes_and_changes_nothing(harness: Harness) -> None:
    name = proposal(harness)
    (listed,) = harness.get("/calibrations")["calibrations"]
    assert listed == harness.get(f"/calibrations/{name}")
    assert (listed["state"], listed["calibration"]) == ("proposed", "noise")
    value, drift = listed["values"]
    assert drift["quantity"] == "sensor.drift_um_per_min"
    assert drift["source_in_use"] == "assumed"
    assert 2.0 * drift["uncertainty"] <= drift["value"] < 1.0
    assert value["value"] == pytest.approx(0.03, rel=0.15)
    assert value["in_use"] == 0.03
    assert value["source_in_use"] == "assumed"
    assert value["difference"] == pytest.approx(value["value"] - 0.03)
    assert value["difference_percent"] == pytest.approx(value["difference"] / 0.03 * 100.0)
    assert 0.0 < value["uncertainty"] < 0.005
    assert listed["residuals"]["count"] == 200
    assert "95 %" in listed["statement"]
    assert in_use(harness, "sensor.noise_um")["source"] == "assumed"
    assert harness.get("/rigs/demo")["model"] == {"version": 0, "digest": ""}
    plot = harness.call("GET", listed["plot"])
    assert plot.headers["content-type"] == "image/png"


def test_later_jobs_use_the_accepted_values(harness: Harness) -> None:
    name = proposal(harness)
    accepted = decide(harness, name, "accept").json()
    assert (accepted["state"], accepted["model_version"]) == ("accepted", 1)
    used = in_use(harness, "sensor.noise_um")
    assert used["source"] == name
    assert used["value"] == accepted["values"][0]["value"]
    model = harness.get("/rigs/demo/model")
    (version,) = model["versions"]
    assert version["quantities"] == ["sensor.drift_um_per_min", "sensor.noise_um"]
    harness.bus.edit = list
    job = harness.ended(harness.grip()["id"])
    assert job["values"]["model"] == {"version": 1, "digest": model["digest"]}
    assert harness.bus.calibration == model["digest"] == version["digest"]
    manifest = json.loads((Path(job["record"]) / folder.MANIFEST).read_text(encoding="utf-8"))
    assert (manifest["model_version"], manifest["model_digest"]) == ("1", model["digest"])
    assert manifest["rig_file_digest"] == harness.get("/rigs/demo")["digest"]
    assert harness.get("/rigs/demo")["can_start"] is True
    # The difference is that from the value used until then.
    assert harness.get(f"/calibrations/{name}")["values"][0]["in_use"] == 0.03


@pytest.mark.parametrize("action", ["accept", "discard"])
def test_a_proposal_can_be_decided_only_once(harness: Harness, action: str) -> None:
    name = proposal(harness)
    decided = decide(harness, name, action).json()
    assert decided["allowed_actions"] == []
    for again in ("accept", "discard"):
        response = decide(harness, name, again)
        assert response.status_code == 409
        assert response.json()["type"].endswith("invalid-transition")
        assert decided["state"] in response.json()["detail"]
    assert harness.get("/rigs/demo/model")["version"] == (1 if action == "accept" else 0)


def test_an_accepted_proposal_supersedes_earlier_ones_of_its_kind(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bring_up, "PAGE", 1)
    first, second, third = (proposal(harness, noise_um) for noise_um in (0.02, 0.03, 0.04))
    decide(harness, first, "accept")
    decide(harness, third, "accept")
    states = {item["id"]: item["state"] for item in harness.get("/calibrations")["calibrations"]}
    assert states == {first: "superseded", second: "superseded", third: "accepted"}
    assert harness.get("/rigs/demo/model")["version"] == 2
    assert decide(harness, second, "accept").status_code == 409


def test_a_rig_can_return_to_an_earlier_model_or_to_its_rig_file(harness: Harness) -> None:
    for noise_um in (0.02, 0.04):
        decide(harness, proposal(harness, noise_um), "accept")
    values = [in_use(harness, "sensor.noise_um")["value"]]
    for version in (1, 0):
        body = {"type": "use", "version": version}
        assert harness.post("/rigs/demo/model/actions", body).json()["version"] == version
        values.append(in_use(harness, "sensor.noise_um")["value"])
    assert values == pytest.approx([0.04, 0.02, 0.03], rel=0.15)
    unknown = harness.post("/rigs/demo/model/actions", {"type": "use", "version": 7})
    assert unknown.status_code == 404
    assert "no version of the model '7'; there are 0, 1, 2" in unknown.json()["detail"]


def test_nothing_changes_while_a_job_uses_the_rig(harness: Harness) -> None:
    name = proposal(harness)
    job = harness.post("/jobs", {"kind": "grip"}).json()["id"]
    harness.reach(job, "ready")
    for path, body in (
        (f"/calibrations/{name}/actions", {"type": "accept"}),
        ("/rigs/demo/model/actions", {"type": "use", "version": 0}),
    ):
        response = harness.post(path, body)
        assert response.status_code == 409
        assert response.json()["type"].endswith("job-active")
    assert harness.get("/rigs/demo/model")["version"] == 0


def test_values_that_make_an_impossible_rig_are_refused(harness: Harness) -> None:
    name = proposal(harness)
    row = harness.store.get(name)
    assert row is not None
    assert row.result is not None
    row.result["values"][0]["value"] = -1.0
    harness.store.change(name, result=row.result)
    response = decide(harness, name, "accept")
    assert response.status_code == 422
    assert "sensor.noise_um = -1.0" in response.json()["detail"]
    assert harness.get(f"/calibrations/{name}")["state"] == "proposed"
    assert harness.get("/rigs/demo/model")["versions"] == []


def test_uninformative_readings_fail_the_job_and_propose_nothing(harness: Harness) -> None:
    harness.bus.edit = at_rest(0.0)
    job = harness.calibrated()
    assert job["state"] == "failed"
    assert "no values: all 200 readings are 0 µm" in job["cause"]
    assert job["result"]["values"] == []
    assert harness.get("/calibrations")["calibrations"] == []
    assert harness.call("GET", f"/api/v1/calibrations/{job['id']}").status_code == 404
    listed = harness.get(f"/jobs/{job['id']}/artifacts")["artifacts"]
    assert "calibration.png" in [entry["name"] for entry in listed]


def waits(harness: Harness, job: str) -> dict[str, Any]:
    """The job once it waits for a person."""

    async def waiting() -> None:
        live = harness.live
        while live.status.waiting is None:
            await asyncio.sleep(0)

    asyncio.run(asyncio.wait_for(waiting(), 10.0))
    return harness.get(f"/jobs/{job}")


def test_a_job_waits_for_each_weight(harness: Harness) -> None:
    harness.bus.edit = lambda ticks: samples.weighing(
        ticks[0].position.epoch, STEPS, TRUE_UM_PER_MN
    )
    harness.bus.pauses = [step * STEP_TICKS + samples.HANG_TICKS - 1 for step in range(len(STEPS))]
    body = {"calibration": "compliance", "weights_mN": [0.0, 5.0, 10.0], "autostart": True}
    name = harness.post("/calibrations", body).json()["id"]
    harness.reach(name, "running")
    for weight_mN in STEPS:
        job = waits(harness, name)
        assert job["allowed_actions"] == ["pause", "stop", "abort", "continue"]
        assert job["progress"]["weight_mN"] == weight_mN
        hang = f"hang {weight_mN:g} mN on the tip" if weight_mN else "take every weight off the tip"
        assert job["progress"]["instruction"] == hang
        assert job["progress"]["planned_s"] is None
        response = harness.post(f"/jobs/{name}/actions", {"type": "continue"})
        assert response.status_code == 202
    ended = harness.ended(name)
    assert (ended["state"], ended["cause"]) == ("succeeded", "")
    assert [action["type"] for action in ended["actions"]] == ["continue"] * len(STEPS)
    (value,) = harness.get(f"/calibrations/{name}")["values"]
    assert value["quantity"] == "model.compliance_um_per_mN"
    assert value["value"] == pytest.approx(TRUE_UM_PER_MN, rel=0.01)


def test_a_job_that_does_not_wait_cannot_be_continued(harness: Harness) -> None:
    harness.bus.edit, harness.bus.pause_at = at_rest(), 50
    body = {"calibration": "noise", "autostart": True}
    name = harness.post("/calibrations", body).json()["id"]
    harness.reach(name, "running")
    response = harness.post(f"/jobs/{name}/actions", {"type": "continue"})
    assert response.status_code == 409
    assert "continue" not in response.json()["allowed_actions"]
    harness.post(f"/jobs/{name}/actions", {"type": "stop"})
    stopped = harness.ended(name)
    assert stopped["state"] == "stopped"
    assert stopped["result"]["values"] == []


def test_a_service_that_uses_another_model_than_the_armed_one_is_named(
    harness: Harness,
) -> None:
    decide(harness, proposal(harness), "accept")
    assert harness.get("/rigs/demo")["reasons"] == []
    harness.bus.edit = list
    assert harness.ended(harness.grip()["id"])["state"] == "succeeded"
    harness.bus.calibration = ""
    harness.health.refresh(force=True)
    reasons = harness.get("/rigs/demo")["reasons"]
    assert any("uses model of the rig file, armed with" in reason for reason in reasons)


def with_sensor(rig: RigFile, **changes: Any) -> RigFile:
    return rig.model_copy(update={"sensor": rig.sensor.model_copy(update=changes)})


def heard_idle(harness: Harness) -> None:
    """The state of an actuator that an earlier supervisor knew is unknown before its first
    message."""
    assert harness.get("/rigs/demo")["latch"]["state"] == "unknown"
    harness.bus.latch = ""
    harness.bus.idle()


def test_the_model_in_use_is_kept_after_a_restart_but_not_after_a_change_of_the_instrument(
    harness: Harness, rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    decide(harness, proposal(harness), "accept")
    again = open_harness(rig_file)
    assert again.get("/rigs/demo/model")["version"] == 1
    other = open_harness(with_sensor(rig_file, direction=-1))
    model = other.get("/rigs/demo/model")
    assert model["version"] == 0
    assert model["changed"] == [{"key": "sensor.direction", "before": 1, "now": -1}]
    assert "not used, because sensor.direction = -1, was 1" in model["trouble"]
    assert "`pincette model use 1` if it is still valid" in model["trouble"]
    assert "sensor.direction" in model["versions"][0]["trouble"]
    refused = other.post("/jobs", {"kind": "grip"})
    assert refused.status_code == 503
    assert any(reason.startswith("model: ") for reason in refused.json()["reasons"])
    body = {"type": "use", "version": 1}
    used = other.post("/rigs/demo/model/actions", body).json()
    assert (used["trouble"], used["changed"]) == ("", [])
    heard_idle(other)
    assert other.get("/rigs/demo")["can_start"] is True


def test_the_model_in_use_does_not_depend_on_limits_grip_defaults_or_the_part(
    harness: Harness, rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    decide(harness, proposal(harness), "accept")
    assert rig_file.simulation is not None
    changes = {
        "limits": rig_file.limits.model_copy(update={"force_max_mN": 35.0}),
        "grip": rig_file.grip.model_copy(update={"force_mN": 8.0}),
        "part": rig_file.part.model_copy(update={"contact_um": 31.0, "name": "another"}),
        "simulation": rig_file.simulation.model_copy(update={"bead_contact_um": 33.0}),
    }
    other = open_harness(rig_file.model_copy(update=changes))
    model = other.get("/rigs/demo/model")
    assert (model["version"], model["trouble"], model["changed"]) == (1, "", [])
    assert in_use(other, "part.contact_um")["value"] == 31.0
    heard_idle(other)
    assert other.get("/rigs/demo")["can_start"] is True


def test_a_value_changed_in_the_rig_file_replaces_only_the_same_value_of_the_model(
    harness: Harness, rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    decide(harness, proposal(harness), "accept")
    harness.manager.context.model.add({"part.contact_um": 30.5}, {}, "a press")
    part = rig_file.part.model_copy(update={"contact_um": 45.0})
    other = open_harness(rig_file.model_copy(update={"part": part}))
    model = other.get("/rigs/demo/model")
    assert (model["version"], model["trouble"]) == (2, "")
    assert model["set_aside"] == [{"key": "part.contact_um", "before": 30.0, "now": 45.0}]
    assert in_use(other, "part.contact_um")["value"] == 45.0
    assert in_use(other, "part.contact_um")["source"] == "assumed"
    assert in_use(other, "sensor.noise_um")["source"] != "assumed"
    (warning,) = other.get("/rigs/demo")["warnings"]
    assert "part.contact_um = 45.0, was 30.0" in warning
    other.post("/rigs/demo/model/actions", {"type": "use", "version": 2})
    assert in_use(other, "part.contact_um")["value"] == 30.5
    assert other.get("/rigs/demo")["warnings"] == []
