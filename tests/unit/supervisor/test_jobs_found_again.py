"""Jobs that are described, found again, exported, pinned, and whose records are deleted."""

import csv
import io
import json
from pathlib import Path
from typing import Any

import pytest

from pincette.records import folder, parquet
from pincette_recorder import retention

from .canned import IN_APPROACH, IN_HOLD
from .harness import Harness

SAID: dict[str, Any] = {
    "sample": "B7",
    "batch": "März 甲",
    "operator": "Éva",
    "notes": "first of the wafer",
    "labels": {"glue": "none"},
}


def gripped(harness: Harness, **wishes: Any) -> str:
    job = str(harness.grip(**wishes)["id"])
    harness.freed(job)
    return job


def edited(harness: Harness, job: str, **body: Any) -> dict[str, Any]:
    answer = harness.call("PATCH", f"/api/v1/jobs/{job}", json=body, headers={"X-Operator": "Ada"})
    assert answer.status_code == 200, answer.text
    return answer.json()


def record(harness: Harness, job: str) -> Path:
    return harness.manager.context.records / job


def manifest(harness: Harness, job: str) -> dict[str, Any]:
    return json.loads((record(harness, job) / folder.MANIFEST).read_text(encoding="utf-8"))


def test_labels_given_at_the_start_are_in_job_manifest_report_and_samples(harness: Harness) -> None:
    job = gripped(harness, **SAID)
    view = harness.get(f"/jobs/{job}")
    assert {name: view[name] for name in SAID} == SAID
    stated = manifest(harness, job)
    texts = {name: text for name, text in SAID.items() if name != "labels"}
    assert stated.items() >= {**texts, "label glue": "none"}.items()
    page = (record(harness, job) / folder.REPORT).read_text(encoding="utf-8")
    assert all(text in page for text in texts.values())
    schema = parquet.opened(record(harness, job) / folder.SAMPLES).schema_arrow
    metadata: dict[str, str] = {
        key.decode(): text.decode() for key, text in schema.metadata.items()
    }
    assert metadata.items() >= {**texts, "label glue": "none"}.items()


def test_labels_given_afterwards_are_in_job_manifest_and_report(harness: Harness) -> None:
    job = gripped(harness, sample="wafer 6 / die 3", labels={"glue": "none"})
    before = harness.get(f"/jobs/{job}")
    samples = (record(harness, job) / folder.SAMPLES).read_bytes()
    after = edited(harness, job, sample="B7", notes="chip <b>", labels={"lamp": "2"})
    assert (after["sample"], after["notes"], after["labels"]) == ("B7", "chip <b>", {"lamp": "2"})
    assert after["revision"] > before["revision"]
    assert after["request"]["sample"] == "wafer 6 / die 3"
    stated = manifest(harness, job)
    assert (stated["sample"], stated["label lamp"]) == ("B7", "2")
    assert "label glue" not in stated
    page = (record(harness, job) / folder.REPORT).read_text(encoding="utf-8")
    assert "chip &lt;b&gt;" in page
    assert "die 3" not in page
    assert (record(harness, job) / folder.SAMPLES).read_bytes() == samples
    for file in harness.get(f"/jobs/{job}/artifacts")["artifacts"]:
        if file["name"] != folder.MANIFEST:
            assert file["sha256"] in [entry["sha256"] for entry in stated["files"]]
    (event,) = harness.told("edit", job=job)
    assert event.body == {"changed": ["labels", "notes", "sample"], "by": "Ada"}


def test_labels_given_to_running_and_queued_jobs_are_kept(harness: Harness) -> None:
    running = harness.playing_to(IN_HOLD)
    queued = harness.grip(queue=True)["id"]
    assert edited(harness, running, sample="B8")["state"] == "running"
    assert edited(harness, queued, sample="B9")["position"] == 1
    harness.bus.pause_at = None
    harness.bus.play()
    assert harness.ended(queued)["sample"] == "B9"
    assert manifest(harness, running)["sample"] == "B8"


@pytest.mark.parametrize(
    ("body", "pointer"),
    [({"sample": 7}, "/sample"), ({"colour": "red"}, "/colour"), ({"notes": "x" * 4001}, "/notes")],
)
def test_invalid_labels_are_refused(harness: Harness, body: dict[str, Any], pointer: str) -> None:
    job = gripped(harness)
    answer = harness.call("PATCH", f"/api/v1/jobs/{job}", json=body)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["pointer"] == pointer
    assert harness.call("PATCH", "/api/v1/jobs/none", json={"sample": "B7"}).status_code == 404


def test_jobs_are_found_by_their_labels(harness: Harness) -> None:
    other, job = gripped(harness, sample="B70"), gripped(harness, **SAID)
    edited(harness, job, pinned=True)
    queries: list[dict[str, Any]] = [
        {"sample": "B7"},
        {"batch": "März 甲"},
        {"operator": "Éva"},
        {"text": "wafer"},
        {"label": "glue=none", "kind": "grip"},
        {"pinned": "true"},
    ]
    for query in queries:
        assert [one["id"] for one in harness.get("/jobs", **query)["jobs"]] == [job], query
    assert {one["id"] for one in harness.get("/jobs", text="B7")["jobs"]} == {other, job}


def test_many_jobs_are_exported_as_one_table(harness: Harness, tmp_path: Path) -> None:
    first = gripped(harness, **{**SAID, "notes": '=1+1, "a"'})
    second = gripped(harness, force_mN=12.5)
    text = harness.call("GET", "/api/v1/jobs/export.csv").text
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [row["id"] for row in rows] == [second, first]
    result = harness.get(f"/jobs/{first}")["result"]
    assert float(rows[1]["result.peak_force_mN"]) == result["peak_force_mN"]
    assert (rows[1]["label.glue"], rows[0]["label.glue"]) == ("none", "")
    assert rows[1]["notes"] == '\'=1+1, "a"'
    assert float(rows[0]["value.force_mN"]) == 12.5
    answer = harness.call("GET", "/api/v1/jobs/export.parquet?sample=B7")
    (tmp_path / "jobs.parquet").write_bytes(answer.content)
    table = parquet.opened(tmp_path / "jobs.parquet").read()
    assert table["id"].to_pylist() == [first]
    assert table.schema.field("result.peak_force_mN").metadata[b"unit"] == b"mN"
    empty = harness.call("GET", "/api/v1/jobs/export.csv?sample=none")
    assert empty.text.startswith("id,rig,kind,state")


def test_a_pinned_record_is_neither_deleted_nor_found_by_the_retention(harness: Harness) -> None:
    job, other = gripped(harness), gripped(harness)
    records = harness.manager.context.records
    assert {kept.name for kept in retention.ended(records)} == {job, other}
    edited(harness, job, pinned=True)
    assert {kept.name for kept in retention.ended(records)} == {other}
    refused = harness.call("DELETE", f"/api/v1/jobs/{job}/record")
    assert (refused.status_code, refused.json()["type"]) == (
        409,
        "urn:pincette:problem:record-kept",
    )
    edited(harness, job, pinned=False)
    assert {kept.name for kept in retention.ended(records)} == {job, other}


def test_a_record_is_deleted_and_the_job_stays(harness: Harness) -> None:
    job = gripped(harness)
    headers = {"X-Operator": "Ada"}
    answer = harness.call("DELETE", f"/api/v1/jobs/{job}/record", headers=headers)
    assert answer.status_code == 200, answer.text
    reply = answer.json()
    assert (reply["record"], reply["record_complete"]) == (None, None)
    assert reply["record_detail"] == "deleted by Ada"
    assert reply["result"]["outcome"] == "gripped"
    assert not record(harness, job).exists()
    assert harness.get(f"/jobs/{job}/artifacts")["artifacts"] == []
    assert harness.call("DELETE", f"/api/v1/jobs/{job}/record").status_code == 404
    running = harness.playing_to(IN_APPROACH)
    assert harness.call("DELETE", f"/api/v1/jobs/{running}/record").status_code == 409
