"""Trajectories over REST: created, stored, sampled, drawn, and used in jobs."""

from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from typing import Any

import pyarrow.parquet
import pytest

from pincette.config import RigFile
from pincette_supervisor.journal import library
from pincette_supervisor.journal.library import TrajectoryRepository, TrajectoryRow
from pincette_supervisor.journal.store import Store

from .harness import Harness

PNG = b"\x89PNG\r\n\x1a\n"
ROW = TrajectoryRow("demo", {"kind": "grip", "force_mN": 8.0}, "a" * 16, 0, "")
parquet: Any = pyarrow.parquet


def made(harness: Harness, **wishes: Any) -> dict[str, Any]:
    response = harness.post("/trajectories", {"kind": "grip", "hold_s": 0.5, **wishes})
    assert response.status_code == 201, response.text
    return response.json()


def test_a_trajectory_is_planned_predicted_and_stored(harness: Harness) -> None:
    body = {"kind": "grip", "hold_s": 0.5, "force_mN": 12.0, "autostart": True}
    response = harness.post("/trajectories", body)
    assert response.status_code == 201
    tree = response.json()
    assert response.headers["Location"] == f"trajectories/{tree['digest']}"
    assert tree["request"] == {"kind": "grip", "hold_s": 0.5, "force_mN": 12.0}
    assert tree["plan"]["feasible"]
    prediction = tree["plan"]["prediction"]
    assert prediction["outcome"] == "gripped"
    assert prediction["peaks"]["force_max_mN"] == pytest.approx(12.0, abs=0.2)
    assert tree["values"]["force_mN"] == 12.0
    assert tree["samples"] == pytest.approx(prediction["duration_s"] / tree["period_s"])
    assert harness.get(f"/trajectories/{tree['digest']}") == tree
    (listed,) = harness.get("/trajectories")["trajectories"]
    assert listed == {name: tree[name] for name in listed}


def test_the_same_request_is_the_same_trajectory(harness: Harness) -> None:
    first = made(harness, labels={"part": "12"})
    again = harness.post("/trajectories", {"hold_s": 0.5, "kind": "grip", "queue": True})
    assert again.status_code == 200
    assert again.json() == first
    assert made(harness, force_mN=8.0)["digest"] != first["digest"]
    assert len(harness.get("/trajectories")["trajectories"]) == 2
    assert len(harness.get("/trajectories", limit=1)["trajectories"]) == 1


def test_a_trajectory_that_breaks_a_limit_is_not_stored(harness: Harness) -> None:
    body = {"kind": "grip", "force_mN": 55.0}
    refused = harness.post("/trajectories", body)
    assert refused.status_code == 422
    first, *_ = refused.json()["violations"]
    assert (first["pointer"], first["limit"], first["unit"]) == ("/force_mN", 40.0, "mN")
    looked = harness.post("/trajectories", body, dry_run=True)
    assert looked.status_code == 200
    assert not looked.json()["feasible"]
    assert looked.json()["prediction"]["outcome"] == "overforce"
    assert harness.get("/trajectories")["trajectories"] == []
    drawn = harness.post("/trajectories/plot", body)
    assert drawn.headers["Content-Type"] == "image/png"
    assert drawn.content.startswith(PNG)


def test_samples_are_available_in_three_forms_with_units(harness: Harness) -> None:
    digest = made(harness)["digest"]
    tree = harness.get(f"/trajectories/{digest}/samples")
    samples = tree["samples"]
    units = {column["name"]: column["unit"] for column in tree["columns"]}
    assert list(samples) == list(units)
    assert units["force_mN"] == "mN"
    assert samples["t_s"][1] == tree["period_s"]
    assert max(samples["force_mN"]) == pytest.approx(20.0, abs=0.3)

    text = harness.call("GET", f"/api/v1/trajectories/{digest}/samples.csv")
    assert text.headers["Content-Type"].startswith("text/csv")
    lines = text.text.splitlines()
    assert f"# trajectory: {digest}" in lines
    assert "# x_um [µm]: position of the tip, predicted" in lines
    head = next(number for number, line in enumerate(lines) if not line.startswith("#"))
    assert lines[head].split(",") == list(samples)
    assert len(lines) - head - 1 == len(samples["t_s"])
    last = dict(zip(lines[head].split(","), lines[-1].split(","), strict=True))
    assert float(last["voltage_V"]) == samples["voltage_V"][-1]

    raw = harness.call("GET", f"/api/v1/trajectories/{digest}/samples.parquet").content
    table = parquet.read_table(BytesIO(raw))
    assert table.to_pydict() == samples
    assert table.schema.field("x_um").metadata[b"unit"].decode() == "µm"
    assert table.schema.metadata[b"trajectory"].decode() == digest
    unknown = harness.call("GET", f"/api/v1/trajectories/{digest}/samples?format=csv")
    assert unknown.status_code == 422


def test_a_trajectory_is_drawn(harness: Harness) -> None:
    digest = made(harness)["digest"]
    drawn = harness.call("GET", f"/api/v1/trajectories/{digest}/plot")
    assert drawn.status_code == 200
    assert drawn.headers["Content-Type"] == "image/png"
    assert drawn.content.startswith(PNG)


def test_a_job_is_created_from_a_trajectory(harness: Harness) -> None:
    digest = made(harness, force_mN=20.0)["digest"]
    path, body = f"/api/v1/trajectories/{digest}/jobs", {"autostart": True, "labels": {"a": "b"}}
    headers = {"Idempotency-Key": "one"}
    response = harness.call("POST", path, json=body, headers=headers)
    assert response.status_code == 201, response.text
    job = response.json()
    assert response.headers["Location"] == f"../../jobs/{job['id']}"
    assert job["request"] == {"kind": "grip", "hold_s": 0.5, "force_mN": 20.0, **body}
    assert harness.ended(job["id"])["state"] == "succeeded"
    again = harness.call("POST", path, json=body, headers=headers)
    assert again.status_code == 200
    assert again.json()["id"] == job["id"]


def test_a_job_of_a_trajectory_may_wait_for_its_start(harness: Harness) -> None:
    digest = made(harness)["digest"]
    response = harness.post(f"/trajectories/{digest}/jobs")
    assert response.status_code == 201
    harness.reach(response.json()["id"], "ready")


def test_a_trajectory_of_a_kind_that_is_not_installed_is_stale(harness: Harness) -> None:
    digest = made(harness)["digest"]
    book = TrajectoryRepository(harness.manager.context.store)
    row = book.get(digest)
    assert row is not None
    old, _ = book.add(replace(row, request={**row.request, "kind": "pair_grip"}))
    assert len(harness.get("/trajectories")["trajectories"]) == 2
    (words,) = harness.get(f"/trajectories/{old.digest}")["stale"]
    assert "pair_grip is no longer known" in words
    refused = harness.post(f"/trajectories/{old.digest}/jobs", {})
    assert refused.json()["type"].endswith("trajectory-stale")


def test_another_model_makes_a_trajectory_stale(harness: Harness) -> None:
    tree = made(harness)
    model = harness.manager.context.model
    model.add({"model.compliance_um_per_mN": 0.5}, {}, "a test")
    seen = harness.get(f"/trajectories/{tree['digest']}")
    assert seen["plan"] == tree["plan"]
    assert seen["stale"] == [
        f"model: the rig file alone was in use, now it is version 1 ({model.in_use.digest})"
    ]
    refused = harness.post(f"/trajectories/{tree['digest']}/jobs", {})
    assert refused.status_code == 409
    assert refused.json()["type"].endswith("trajectory-stale")
    assert refused.json()["changed"] == seen["stale"]
    after = made(harness)
    assert after["digest"] != tree["digest"]
    model.use(0)
    assert harness.get(f"/trajectories/{tree['digest']}")["stale"] == []
    earlier = harness.get(f"/trajectories/{after['digest']}")
    assert earlier["plan"] == after["plan"]
    assert "version 1" in earlier["stale"][0]


def test_another_rig_file_does_not_change_the_request(
    harness: Harness, rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    digest = made(harness)["digest"]
    limits = rig_file.limits.model_copy(update={"force_max_mN": 35.0})
    other = open_harness(rig_file.model_copy(update={"limits": limits}))
    seen = other.get(f"/trajectories/{digest}")
    assert seen["plan"] is None
    assert seen["request"] == {"kind": "grip", "hold_s": 0.5}
    assert seen["stale"][0].startswith("rig file ")
    for path in ("samples", "plot"):
        refused = other.call("GET", f"/api/v1/trajectories/{digest}/{path}")
        assert refused.status_code == 409
        assert refused.json()["type"].endswith("trajectory-stale")


def test_a_move_needs_a_target_position(harness: Harness) -> None:
    response = harness.post("/trajectories", {"kind": "move", "to_um": 12.5})
    assert response.status_code == 201
    assert response.json()["plan"]["prediction"]["outcome"] == "moved"
    digest = response.json()["digest"]
    refused = harness.post("/trajectories", {"kind": "move", "by_um": 2.0})
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"] == "/by_um"
    odd = harness.post(f"/trajectories/{digest}/jobs", {"on_stop": "release"})
    assert odd.status_code == 422
    assert odd.json()["errors"][0]["pointer"] == "/on_stop"


@pytest.mark.parametrize("path", ["", "/samples", "/plot"])
def test_an_unknown_trajectory_is_not_found(harness: Harness, path: str) -> None:
    assert harness.call("GET", f"/api/v1/trajectories/nothing{path}").status_code == 404


def test_a_calibration_is_not_a_trajectory(harness: Harness) -> None:
    body = {"kind": "calibrate", "calibration": "noise"}
    refused = harness.post("/trajectories", body)
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"] == "/kind"


def test_a_dry_run_predicts_unless_disabled(harness: Harness) -> None:
    body = {"kind": "grip", "hold_s": 0.5}
    with_it = harness.post("/jobs", body, dry_run=True).json()
    assert with_it["prediction"]["outcome"] == "gripped"
    without = harness.post("/jobs", body, dry_run=True, predict=False).json()
    assert without["prediction"] is None
    assert with_it | {"prediction": None} == without
    flat = harness.post("/jobs", body, dry_run=True, curves=False).json()
    assert {*flat["curves"], *flat["prediction"]["curves"]} > {"voltage_V", "phase"}
    assert not any([*flat["curves"].values(), *flat["prediction"]["curves"].values()])
    assert flat["prediction"]["peaks"] == with_it["prediction"]["peaks"]


def test_the_digest_of_a_trajectory_depends_on_request_rig_file_and_model() -> None:
    same = replace(ROW, request=dict(reversed(ROW.request.items())), created_at="later")
    assert same.digest == ROW.digest
    assert len(ROW.digest) >= 16
    others = [
        replace(ROW, rig="other"),
        replace(ROW, request={**ROW.request, "force_mN": 9.0}),
        replace(ROW, rig_file_digest="b" * 16),
        replace(ROW, model_digest="c" * 16, model_version=1),
    ]
    assert len({ROW.digest, *(row.digest for row in others)}) == 5


def test_the_oldest_trajectories_are_deleted(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter(f"2026-03-01T12:00:0{second}.000Z" for second in range(9))
    monkeypatch.setattr(library, "utc_now", lambda: next(times))
    monkeypatch.setattr(library, "TRAJECTORIES_MAX", 2)
    book = TrajectoryRepository(store)
    rows = [book.add(replace(ROW, request={"force_mN": force}))[0] for force in (1.0, 2.0, 3.0)]
    assert book.newest(10) == rows[:0:-1]
    assert book.get(rows[0].digest) is None
    assert book.add(rows[2]) == (rows[2], False)
