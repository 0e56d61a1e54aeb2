"""Repeated motions with real processes: learning over cycles, and a motion replayed without its
part."""

import json
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any, cast

import pyarrow.parquet as parquet
import pytest

from pincette.core.messages import Applied, Estimate, Position
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.track import TrackJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig

pytestmark = pytest.mark.full

LEARNING = TrackJobRequest(
    kind="track",
    autostart=True,
    shape="sinusoid",
    force_mean_mN=12.0,
    force_pp_mN=10.0,
    frequency_hz=2.0,
    cycles=10,
    load_s=1.0,
    learn=True,
    set="consistent",
)
"""Law that leaves an error to learn."""
SKEWED: Json = {
    "limits": {"slew_V_per_s": 40.0},
    "simulation": {"hysteresis": {"asymmetry": 0.1}, "scripts": True},
}
"""An arm whose hysteresis differs from that of its model."""


@pytest.fixture
def rig(tmp_path: Path) -> Generator[RunningRig]:
    with running_rig(demo_rig(SKEWED, time="lockstep"), tmp_path) as running:
        yield running


def done(rig: RunningRig, body: Json) -> Json:
    job = rig.ended(rig.post("/jobs", body).raise_for_status().json()["id"], timeout_s=120.0)
    assert job["state"] == "succeeded", job["cause"]
    return job


def recorded(rig: RunningRig, job: str) -> dict[str, list[Any]]:
    names = ["x_um", "force_mN", "voltage_V"]
    table = cast(Any, parquet).read_table(
        rig.data / "jobs" / job / "samples.parquet", columns=names
    )
    return cast("dict[str, list[Any]]", table.to_pydict())


def typed(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pincette", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)


def replayed(rig: RunningRig, *jobs: str) -> None:
    """Check that every service reproduces the records, one after another, to the last bit."""
    folders = [str(rig.data / "jobs" / job) for job in jobs]
    output = typed("records", "replay", "--json", *folders)
    assert output.returncode == 0, output.stdout + output.stderr
    for found in json.loads(output.stdout):
        for one in found["services"]:
            assert (one["first"], one["stopped"]) == (None, ""), one


def test_ten_cycles_are_learned_stored_continued_and_erased(rig: RunningRig) -> None:
    body = LEARNING.model_dump(mode="json", exclude_unset=True)
    first = done(rig, body)
    learned = first["result"]["learned"]
    errors = [one["position_um"] for one in first["result"]["cycles"]]
    print("first job:", [f"{error:.3f}" for error in errors], learned)
    assert len(errors) == 10
    assert learned["errors_um"] == pytest.approx(errors[: learned["cycles"]])
    assert min(errors) < 0.4 * errors[0]

    published = ComposedLoop(rig.rig).play(plan_job(LEARNING, rig.rig).program)
    assert recorded(rig, first["id"]) == {
        "x_um": [m.arms[0].x_um for m in published if isinstance(m, Position)],
        "force_mN": [m.arms[0].force_mN for m in published if isinstance(m, Estimate)],
        "voltage_V": [
            m.arms[0].voltage_V for m in published if isinstance(m, Applied) and m.seq >= 0
        ],
    }

    (kept,) = rig.get("/rigs/demo/learning")["programs"]
    assert (kept["program"], kept["cycles"]) == (learned["program"], learned["cycles"])
    second = done(rig, body)
    again = [one["position_um"] for one in second["result"]["cycles"]]
    print("second job:", [f"{error:.3f}" for error in again])
    assert again[0] < 0.5 * errors[0]
    replayed(rig, first["id"], second["id"])

    url = f"http://{rig.rig.supervisor.host}:{rig.rig.supervisor.port}"
    shown = typed("learning", "--url", url)
    assert learned["program"] in shown.stdout
    assert typed("learning", "--erase", learned["program"], "--url", url).returncode == 0
    assert rig.get("/rigs/demo/learning")["programs"] == []


def test_a_repeated_recipe_continues_to_learn(rig: RunningRig) -> None:
    """A recipe names a program like a request does, so its jobs continue each other's learning."""
    values = LEARNING.model_dump(mode="json", exclude_unset=True)
    for name in ("kind", "autostart"):
        values.pop(name)
    stored = rig.post("/recipes", {"name": "ripple", "values": values})
    assert stored.is_success, stored.text
    body: Json = {"kind": "track", "recipe": "ripple", "autostart": True}
    errors = [done(rig, body)["result"]["cycles"][0]["position_um"] for _ in range(2)]
    print([f"{error:.3f}" for error in errors])
    assert errors[1] < 0.5 * errors[0]
