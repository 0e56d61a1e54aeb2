"""Calibrations from request to the model in use, against a rig that plays canned samples."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pincette.config import RigFile
from pincette.records import folder

from . import samples
from .rig import Desk
from .samples import Tick

STEPS = (0.0, 5.0, 10.0, 5.0, 0.0)
TRUE_UM_PER_MN = 0.44
STEP_TICKS = samples.HANG_TICKS + 60


def at_rest(noise_um: float = 0.03) -> Callable[[list[Tick]], list[Tick]]:
    return lambda ticks: samples.rest(ticks[0].position.epoch, noise_um)


def proposal(desk: Desk, noise_um: float = 0.03) -> str:
    """A calibration of the noise that has succeeded."""
    desk.bus.edit = at_rest(noise_um)
    job = desk.calibrated()
    assert (job["state"], job["cause"]) == ("succeeded", "")
    return str(job["id"])


def decide(desk: Desk, name: str, action: str) -> Any:
    return desk.post(f"/calibrations/{name}/actions", {"type": action})


def in_use(desk: Desk, quantity: str) -> dict[str, Any]:
    model = desk.get("/rigs/demo/model")
    return next(item for item in model["quantities"] if item["quantity"] == quantity)


def test_a_calibration_proposes_and_changes_nothing(desk: Desk) -> None:
    name = proposal(desk)
    (listed,) = desk.get("/calibrations")["calibrations"]
    assert listed == desk.get(f"/calibrations/{name}")
    assert (listed["state"], listed["calibration"]) == ("proposed", "noise")
    (value,) = listed["values"]
    assert value["value"] == pytest.approx(0.03, rel=0.15)
    assert value["in_use"] == 0.03
    assert value["source_in_use"] == "assumed"
    assert value["difference"] == pytest.approx(value["value"] - 0.03)
    assert value["difference_percent"] == pytest.approx(value["difference"] / 0.03 * 100.0)
    assert 0.0 < value["uncertainty"] < 0.005
    assert listed["residuals"]["count"] == 200
    assert "95 %" in listed["statement"]
    assert in_use(desk, "sensor.noise_um")["source"] == "assumed"
    assert desk.get("/rigs/demo")["model"] == {"version": 0, "digest": ""}
    plot = desk.call("GET", listed["plot"])
    assert plot.headers["content-type"] == "image/png"


def test_what_is_accepted_is_what_later_jobs_work_with(desk: Desk) -> None:
    name = proposal(desk)
    accepted = decide(desk, name, "accept").json()
    assert (accepted["state"], accepted["model_version"]) == ("accepted", 1)
    used = in_use(desk, "sensor.noise_um")
    assert used["source"] == name
    assert used["value"] == accepted["values"][0]["value"]
    model = desk.get("/rigs/demo/model")
    (version,) = model["versions"]
    assert version["quantities"] == ["sensor.noise_um"]
    desk.bus.edit = list
    job = desk.ended(desk.grip()["id"])
    assert job["values"]["model"] == {"version": 1, "digest": model["digest"]}
    assert desk.bus.calibration == model["digest"] == version["digest"]
    manifest = json.loads((Path(job["record"]) / folder.MANIFEST).read_text(encoding="utf-8"))
    assert (manifest["model_version"], manifest["model_digest"]) == ("1", model["digest"])
    assert manifest["rig_file_digest"] == desk.get("/rigs/demo")["digest"]
    assert desk.get("/rigs/demo")["can_start"] is True
    # The difference is that to what was in use until then.
    assert desk.get(f"/calibrations/{name}")["values"][0]["in_use"] == 0.03


@pytest.mark.parametrize("action", ["accept", "discard"])
def test_a_proposal_is_decided_about_once(desk: Desk, action: str) -> None:
    name = proposal(desk)
    decided = decide(desk, name, action).json()
    assert decided["allowed_actions"] == []
    for again in ("accept", "discard"):
        response = decide(desk, name, again)
        assert response.status_code == 409
        assert response.json()["type"].endswith("invalid-transition")
        assert decided["state"] in response.json()["detail"]
    assert desk.get("/rigs/demo/model")["version"] == (1 if action == "accept" else 0)


def test_an_accepted_proposal_supersedes_those_of_its_kind_before_it(desk: Desk) -> None:
    first, second, third = (proposal(desk, noise_um) for noise_um in (0.02, 0.03, 0.04))
    decide(desk, first, "accept")
    decide(desk, third, "accept")
    states = {item["id"]: item["state"] for item in desk.get("/calibrations")["calibrations"]}
    assert states == {first: "superseded", second: "superseded", third: "accepted"}
    assert desk.get("/rigs/demo/model")["version"] == 2
    assert decide(desk, second, "accept").status_code == 409


def test_a_rig_goes_back_to_a_version_and_to_its_file_alone(desk: Desk) -> None:
    for noise_um in (0.02, 0.04):
        decide(desk, proposal(desk, noise_um), "accept")
    values = [in_use(desk, "sensor.noise_um")["value"]]
    for version in (1, 0):
        body = {"type": "use", "version": version}
        assert desk.post("/rigs/demo/model/actions", body).json()["version"] == version
        values.append(in_use(desk, "sensor.noise_um")["value"])
    assert values == pytest.approx([0.04, 0.02, 0.03], rel=0.15)
    unknown = desk.post("/rigs/demo/model/actions", {"type": "use", "version": 7})
    assert unknown.status_code == 422
    assert "no model 7; there are [1, 2]" in unknown.json()["detail"]


def test_nothing_changes_while_a_job_has_the_rig(desk: Desk) -> None:
    name = proposal(desk)
    job = desk.post("/jobs", {"kind": "grip"}).json()["id"]
    desk.reach(job, "ready")
    for path, body in (
        (f"/calibrations/{name}/actions", {"type": "accept"}),
        ("/rigs/demo/model/actions", {"type": "use", "version": 0}),
    ):
        response = desk.post(path, body)
        assert response.status_code == 409
        assert response.json()["type"].endswith("job-active")
    assert desk.get("/rigs/demo/model")["version"] == 0


def test_values_that_make_an_impossible_rig_are_refused(desk: Desk) -> None:
    name = proposal(desk)
    row = desk.store.get(name)
    assert row is not None
    assert row.result is not None
    row.result["values"][0]["value"] = -1.0
    desk.store.change(name, result=row.result)
    response = decide(desk, name, "accept")
    assert response.status_code == 422
    assert "sensor.noise_um = -1.0" in response.json()["detail"]
    assert desk.get(f"/calibrations/{name}")["state"] == "proposed"
    assert desk.get("/rigs/demo/model")["versions"] == []


def test_readings_that_say_nothing_fail_the_job_and_propose_nothing(desk: Desk) -> None:
    desk.bus.edit = at_rest(0.0)
    job = desk.calibrated()
    assert job["state"] == "failed"
    assert "no values: all 200 readings are 0 µm" in job["cause"]
    assert job["result"]["values"] == []
    assert desk.get("/calibrations")["calibrations"] == []
    assert desk.call("GET", f"/api/v1/calibrations/{job['id']}").status_code == 404
    listed = desk.get(f"/jobs/{job['id']}/artifacts")["artifacts"]
    assert "calibration.png" in [entry["name"] for entry in listed]


def waits(desk: Desk, job: str) -> dict[str, Any]:
    """The job once it waits for a person."""

    async def waiting() -> None:
        live = desk.conductor.active
        assert live is not None
        while live.waiting is None:
            await asyncio.sleep(0)

    asyncio.run(asyncio.wait_for(waiting(), 10.0))
    return desk.get(f"/jobs/{job}")


def test_a_job_waits_for_each_weight(desk: Desk) -> None:
    desk.bus.edit = lambda ticks: samples.weighing(ticks[0].position.epoch, STEPS, TRUE_UM_PER_MN)
    desk.bus.pauses = [step * STEP_TICKS + samples.HANG_TICKS - 1 for step in range(len(STEPS))]
    body = {"calibration": "compliance", "weights_mN": [0.0, 5.0, 10.0], "autostart": True}
    name = desk.post("/calibrations", body).json()["id"]
    desk.reach(name, "running")
    for weight_mN in STEPS:
        job = waits(desk, name)
        assert job["allowed_actions"] == ["pause", "stop", "abort", "continue"]
        assert job["progress"]["weight_mN"] == weight_mN
        assert job["progress"]["instruction"].endswith("then POST the action continue")
        assert job["progress"]["planned_s"] is None
        response = desk.post(f"/jobs/{name}/actions", {"type": "continue"})
        assert response.status_code == 202
    ended = desk.ended(name)
    assert (ended["state"], ended["cause"]) == ("succeeded", "")
    assert [action["type"] for action in ended["actions"]] == ["continue"] * len(STEPS)
    (value,) = desk.get(f"/calibrations/{name}")["values"]
    assert value["quantity"] == "model.compliance_um_per_mN"
    assert value["value"] == pytest.approx(TRUE_UM_PER_MN, rel=0.01)


def test_nothing_goes_on_that_does_not_wait(desk: Desk) -> None:
    desk.bus.edit, desk.bus.pause_at = at_rest(), 50
    body = {"calibration": "noise", "autostart": True}
    name = desk.post("/calibrations", body).json()["id"]
    desk.reach(name, "running")
    response = desk.post(f"/jobs/{name}/actions", {"type": "continue"})
    assert response.status_code == 409
    assert "continue" not in response.json()["allowed_actions"]
    desk.post(f"/jobs/{name}/actions", {"type": "stop"})
    stopped = desk.ended(name)
    assert stopped["state"] == "stopped"
    assert stopped["result"]["values"] == []


def test_a_service_that_works_with_another_model_than_it_was_armed_with_is_named(
    desk: Desk,
) -> None:
    decide(desk, proposal(desk), "accept")
    assert desk.get("/rigs/demo")["reasons"] == []
    desk.bus.edit = list
    assert desk.ended(desk.grip()["id"])["state"] == "succeeded"
    desk.bus.calibration = ""
    desk.health.refresh(force=True)
    reasons = desk.get("/rigs/demo")["reasons"]
    assert any("works with model of the rig file, armed with" in reason for reason in reasons)


def test_the_model_outlives_a_restart_but_no_other_rig_file(
    desk: Desk, rig_file: RigFile, open_desk: Callable[..., Desk]
) -> None:
    decide(desk, proposal(desk), "accept")
    again = open_desk(rig_file)
    assert again.get("/rigs/demo/model")["version"] == 1
    part = rig_file.part.model_copy(update={"contact_um": 31.0})
    other = open_desk(rig_file.model_copy(update={"part": part}))
    model = other.get("/rigs/demo/model")
    assert model["version"] == 0
    assert "use version 1 where it still holds" in model["trouble"]
    assert model["versions"][0]["trouble"].startswith("made over rig file")
    refused = other.post("/jobs", {"kind": "grip"})
    assert refused.status_code == 503
    assert any(reason.startswith("model: ") for reason in refused.json()["reasons"])
    body = {"type": "use", "version": 1}
    assert other.post("/rigs/demo/model/actions", body).json()["trouble"] == ""
    assert other.get("/rigs/demo")["can_start"] is True
