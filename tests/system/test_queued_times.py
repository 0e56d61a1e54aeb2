"""A job that waits in the queue: when it was requested, when it started, and when it ended.

REST, the client, the command line and the files of the record state the same times.
"""

import csv
import io
import json
from datetime import UTC, datetime
from time import sleep
from typing import Any

import pyarrow.parquet

from pincette.client import Supervisor
from tests.support.commands import pincette
from tests.support.grips import make_ready
from tests.support.running import RunningRig

parquet: Any = pyarrow.parquet
WAIT_S = 1.5


def utc(text: str) -> datetime:
    assert text.endswith("Z")
    return datetime.fromisoformat(text)


def test_a_queued_job_states_when_it_was_requested_started_and_ended(paced: RunningRig) -> None:
    rig = paced
    make_ready(rig)
    before = datetime.now(UTC)
    first = rig.start_grip(until_released=True)
    second = rig.start_grip(queue=True, sample="B7")
    rig.until_phase(first, "hold")
    sleep(WAIT_S)
    waiting = rig.job(second)
    assert (waiting["state"], waiting["position"]) == ("queued", 1)
    assert (waiting["started_at"], waiting["ended_at"]) == (None, None)
    url = rig.rig.supervisor.url
    listed = pincette("job", "list", "--url", url, "--limit", "2").stdout
    assert "requested" in listed

    rig.post(f"/jobs/{first}/actions", {"type": "release"}).raise_for_status()
    ended = {name: rig.ended(name) for name in (first, second)}
    a, b = ended[first], ended[second]
    assert b["state"] == "succeeded", b["cause"]
    order = [a["created_at"], b["created_at"], a["ended_at"], b["started_at"], b["ended_at"]]
    times = [before, *map(utc, order), datetime.now(UTC)]
    assert times == sorted(times)
    assert (utc(b["started_at"]) - utc(b["created_at"])).total_seconds() >= WAIT_S
    assert b["created_at"] == waiting["created_at"]

    with Supervisor(url) as supervisor:
        reported = supervisor.job(second).job
    assert [reported.created_at, reported.started_at, reported.ended_at] == [
        b[name] for name in ("created_at", "started_at", "ended_at")
    ]
    shown = json.loads(pincette("job", "show", second, "--json", "--url", url).stdout)
    assert {name: shown[name] for name in shown if name.endswith("_at")} == {
        name: b[name] for name in b if name.endswith("_at")
    }
    words = pincette("job", "show", second, "--url", url).stdout
    for name in ("created_at", "started_at", "ended_at"):
        assert utc(b[name]).astimezone().isoformat(sep=" ", timespec="seconds") in words

    # The record states when its samples were taken, beside when the job was requested.
    path = f"/jobs/{second}/artifacts/samples"
    table = parquet.read_table(io.BytesIO(rig.client.get(f"{path}.parquet").content))
    stated = {key.decode(): text.decode() for key, text in table.schema.metadata.items()}
    assert stated["created_at"] == b["created_at"]
    inside = [b["started_at"], stated["sample_0_at"], stated["end_at"]]
    assert list(map(utc, inside)) == sorted(map(utc, inside))
    text = rig.client.get(f"{path}.csv").text
    assert stated["sample_0_at"] in text
    exported = rig.client.get("/jobs/export.csv", params={"sample": "B7"}).text
    rows = {row["id"]: row for row in csv.DictReader(io.StringIO(exported))}
    for name in ("created_at", "started_at", "ended_at"):
        assert utc(rows[second][name]) == utc(b[name])
