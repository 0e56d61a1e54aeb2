"""A hundred grips in a row over REST, through what befalls a cell: no job lost, none doubled."""

import hashlib
import json
import signal
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic, sleep
from typing import Any, cast

import httpx
import numpy as np
import pyarrow.parquet as parquet
import pytest

from tests.support.following import Follower, following
from tests.support.grips import SHORT, restart
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig

GRIPS = 100
REPEATED = range(5, GRIPS, 19)
"""Created twice with one key, as after an answer that was lost."""
KILLED_FREE, KILLED_AT_REST, KILLED_HELD = 23, 51, 77
"""When the supervisor is killed: the arm under way, nothing at all, a part held."""
INTERRUPTED = ("under-way", "held")
"""How the keys of the grips begin during which it is killed."""
PATIENCE = 97
"""Events after which the listener hangs up and comes back."""
AWAY_S = 30.0
SETTLE_S = 0.5
END = {"succeeded", "stopped", "aborted", "failed", "interrupted"}


@dataclass
class Orchestrator:
    """What calls the supervisor: it knows a job by its key until it knows its id."""

    rig: RunningRig
    jobs: dict[str, str] = field(default_factory=dict[str, str])
    """Id by key."""

    def create(self, key: str, **wishes: object) -> httpx.Response:
        """Create a job, with the same key until there is an answer."""
        deadline = monotonic() + AWAY_S
        while True:
            try:
                response = self.rig.client.post(
                    "/jobs", json={"autostart": True, **wishes}, headers={"Idempotency-Key": key}
                )
            except httpx.TransportError:
                assert monotonic() < deadline
                sleep(0.05)
                continue
            assert response.status_code in (200, 201), response.text
            job = cast(str, response.json()["id"])
            assert self.jobs.setdefault(key, job) == job
            return response

    def ended(self, key: str, state: str = "succeeded") -> None:
        """Wait until the job of a key has ended, as it should."""
        job = self.rig.ended(self.jobs[key], AWAY_S)
        assert job["state"] == state, f"{key}: {job['state']}: {job['cause']}"

    def grip(self, number: int, name: str = "grip", **wishes: object) -> str:
        """Create a grip, each of another force; its key."""
        key = f"{name}-{number}"
        self.create(key, kind="grip", force_mN=force_mN(number), **wishes)
        return key

    def reach(self, key: str, there: Callable[[Json], bool]) -> None:
        """Wait until a job's progress says something."""
        deadline = monotonic() + AWAY_S
        while not there(self.rig.job(self.jobs[key])["progress"] or {}):
            assert monotonic() < deadline
            sleep(0.005)

    def restart_supervisor(self) -> None:
        """Kill it without a word, and start it again."""
        self.rig.fleet.signal("supervisor", signal.SIGKILL)
        restart(self.rig, "supervisor")

    def all_jobs(self) -> Iterator[Json]:
        """Every job there is, the newest first."""
        query: dict[str, str | float] = {"limit": 30}
        while True:
            page = self.rig.get("/jobs", **query)
            yield from page["jobs"]
            if page["next"] is None:
                return
            query["before"] = page["next"]


def force_mN(number: int) -> float:
    return 6.0 + number % 5


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    shorter = demo_rig(SHORT, time="lockstep")
    with running_rig(shorter, tmp_path_factory.mktemp("cell")) as running:
        yield running


@pytest.mark.slow
def test_a_hundred_grips_in_a_row(rig: RunningRig, figures: list[str]) -> None:
    begun = monotonic()
    cell = Orchestrator(rig)
    with following(rig, PATIENCE) as follower:
        for number in range(GRIPS):
            if number == KILLED_FREE:
                killed_under_way(cell, number)
            elif number == KILLED_HELD:
                killed_with_a_part_held(cell, number)
            key = cell.grip(number)
            if number in REPEATED:
                repeated(cell, number)
            if number == KILLED_AT_REST:
                cell.ended(key)
                cell.restart_supervisor()
                repeated(cell, number)
            cell.ended(key)
        newest = rig.get("/events/list")["newest"]
        follower.until(newest)
    figures.append(
        f"{GRIPS} grips, 3 supervisors killed, {follower.lines} lines for {len(follower.events)} "
        f"events: {monotonic() - begun:.0f} s"
    )
    check_jobs(cell)
    check_events(cell, follower, newest)
    for number in range(GRIPS):
        check_record(rig, rig.job(cell.jobs[f"grip-{number}"]), force_mN(number))


def repeated(cell: Orchestrator, number: int) -> None:
    """Ask once more for what was asked for; nothing comes of it."""
    response = cell.create(f"grip-{number}", kind="grip", force_mN=force_mN(number))
    assert response.status_code == 200
    assert response.headers["Idempotency-Replayed"] == "true"


def killed_under_way(cell: Orchestrator, number: int) -> None:
    key = cell.grip(number, "under-way", approach_um_per_s=1.0)
    cell.reach(key, lambda progress: progress.get("phase") == "approach")
    cell.restart_supervisor()
    cell.ended(key, "interrupted")
    safe(cell)
    assert cell.rig.view()["part"] == "none"


def killed_with_a_part_held(cell: Orchestrator, number: int) -> None:
    key = cell.grip(number, "held", until_released=True)
    cell.reach(key, lambda progress: progress.get("phase") == "hold")
    cell.restart_supervisor()
    cell.ended(key, "interrupted")
    assert cell.rig.view()["part"] == "held"
    refused = cell.rig.post("/jobs", {"kind": "grip", "autostart": True})
    assert refused.status_code == 409, refused.text
    cell.create("let-go", kind="release")
    cell.ended("let-go")
    # A piezo that was held for long creeps back, and a force that drifts cannot be zeroed.
    safe_V = cell.rig.rig.safety.safe_V
    cell.create("refresh", kind="move", to_V=safe_V, conditioning_cycles=5, zero=False)
    cell.ended("refresh")
    safe(cell)


def safe(cell: Orchestrator) -> None:
    """Wait until the rig can start, as an orchestrator would."""
    deadline = monotonic() + AWAY_S
    while not (view := cell.rig.view())["can_start"]:
        assert monotonic() < deadline, view["reasons"]
        sleep(0.05)
    assert view["active_job"] is None


def check_jobs(cell: Orchestrator) -> None:
    found = [(job["id"], job["state"]) for job in cell.all_jobs()]
    assert len(found) == len(cell.jobs)
    assert dict(found) == {
        job: "interrupted" if key.startswith(INTERRUPTED) else "succeeded"
        for key, job in cell.jobs.items()
    }


def check_events(cell: Orchestrator, follower: Follower, newest: int) -> None:
    numbers = [event["number"] for event in follower.events]
    assert numbers == list(range(1, newest + 1))
    assert follower.lines > newest // PATIENCE
    ends: dict[str, list[str]] = {}
    for event in follower.events:
        if event["kind"] == "state" and event["body"]["state"] in END:
            ends.setdefault(event["job"], []).append(event["body"]["state"])
    states = {job["id"]: job["state"] for job in cell.all_jobs()}
    assert ends == {job: [state] for job, state in states.items()}


def check_record(rig: RunningRig, job: Json, target_mN: float) -> None:
    """What the result says is what the samples say, and the samples are those that were written."""
    folder, result = rig.data / "jobs" / job["id"], cast(Json, job["result"])
    assert job["record_complete"] is True, job["record_detail"]
    assert json.loads((folder / "result.json").read_text(encoding="utf-8")) == result
    check_digests(rig, job["id"], folder)
    table = cast(Any, parquet).read_table(folder / "samples.parquet").to_pydict()
    assert table["seq"] == list(range(result["samples"]))
    assert result["missed_ticks"] == result["dropped_messages"] == 0
    assert result["outcome"] == "gripped"
    assert result["force_target_mN"] == target_mN
    held_mN = settled(table, rig.rig.rig.period_s)
    assert result["force_held_mN"] == pytest.approx(held_mN, rel=1e-12)
    assert held_mN == pytest.approx(target_mN, abs=0.5)


def settled(table: Json, period_s: float) -> float:
    """Mean force over the hold, without its begin."""
    rows = zip(table["phase"], table["force_mN"], strict=True)
    held = [value for phase, value in rows if phase == "hold"]
    return float(np.mean(held[min(round(SETTLE_S / period_s), len(held) // 4) :]))


def check_digests(rig: RunningRig, job: str, folder: Path) -> None:
    told = {item["name"]: item for item in rig.get(f"/jobs/{job}/artifacts")["artifacts"]}
    assert {"job.mcap", "samples.parquet", "result.json", "manifest.json"} <= told.keys()
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    kept = {entry["name"]: entry for entry in manifest["files"]}
    assert kept.keys() == told.keys() - {"manifest.json"}
    for name, entry in kept.items():
        content = (folder / name).read_bytes()
        digest = hashlib.sha256(content).hexdigest()
        assert digest == entry["sha256"] == told[name]["sha256"]
        assert len(content) == entry["bytes"] == told[name]["bytes"]
