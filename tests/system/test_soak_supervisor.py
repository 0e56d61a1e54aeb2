"""A supervisor is killed at random moments of jobs, with a client that repeats its requests.

The replies to the client are compared with the journal, the record, and the messages on the bus.
"""

import json
import random
import threading
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from time import monotonic, sleep
from typing import Any, cast

import httpx
import pyarrow.parquet as parquet
import pytest

from pincette.client import NoAnswerError, ProblemError, RigHandle, Supervisor
from pincette.core.faults import TRIPPED
from pincette.core.messages import Applied, Telemetry
from tests.support.grips import SHORT, kill, make_ready, restart
from tests.support.rigs import paced_rig
from tests.support.running import Json, RunningRig, running_rig
from tests.support.witness import Witness, witness

FEW, MANY = 3, 100
SEED = 20131
LATEST_S = 3.0
"""Longest time between the request, or the start of the motion, and a kill; a grip with its
release takes less."""
PLAYING_SHARE = 0.7
"""Share of kills while a program plays; the others come while a job is planned and armed."""
PATIENCE_S = 60.0
LONGEST_S = 1500.0
"""Time after which no supervisor is killed any more, in s: a busy machine gets fewer rounds, not
a longer test."""
LETTING_GO = ("unload", "retreat")


@dataclass
class Told:
    """Replies to a client, job by job."""

    rig_url: str
    finals: dict[str, Json] = field(default_factory=dict[str, Json])
    keys: dict[str, set[str]] = field(default_factory=dict[str, set[str]])
    """Jobs that a key has created."""
    refusals: Counter[str] = field(default_factory=Counter[str])
    trouble: list[str] = field(default_factory=list[str])
    bare: list[str] = field(default_factory=list[str])
    """Jobs that have ended by themselves, without a picture and a report."""

    def started(self, rig: RigHandle, key: str, kind: str, **wishes: Any) -> Any:
        """Start a job, and repeat the request if the rig is not ready yet."""
        until_s = monotonic() + PATIENCE_S
        while True:
            try:
                job = rig.start(kind, idempotency_key=key, labels={"key": key}, **wishes)
            except ProblemError as problem:
                self.refusals[problem.code] += 1
                if monotonic() > until_s:
                    raise
                sleep(0.2)
            else:
                self.keys.setdefault(key, set()).add(job.id)
                return job

    def ended(self, job: Any) -> None:
        """Wait for the end of a job, and of its record."""
        job.wait(PATIENCE_S)
        job.recorded()
        self.finals[job.id] = job.job.model_dump(mode="json")


def one_grip(rig: RigHandle, number: int, told: Told) -> None:
    """Grip until it holds, then release; release a part that an interrupted job has left."""
    job = told.started(rig, f"grip-{number}", "grip", until_released=True)
    until_s = monotonic() + PATIENCE_S
    while not job.ended:
        assert monotonic() < until_s, job.job
        progress = job.job.progress
        if job.state == "queued" and rig.state().queue.halted:
            # A job that still waited when the supervisor was killed waits for a person, or for this
            # client.
            resume(told)
        if progress is not None and progress.phase == "hold":
            try:
                job.release()
            except ProblemError as problem:  # it has ended meanwhile
                told.refusals[problem.code] += 1
            except NoAnswerError:  # its state is read before the request is repeated
                told.refusals["no answer to a release"] += 1
        sleep(0.1)
        job.refresh()
    told.ended(job)
    while rig.state().part == "held":
        let_go = told.started(rig, f"release-{number}", "release")
        told.ended(let_go)
        if let_go.state == "succeeded":
            break
        number += 1000


def resume(told: Told) -> None:
    """Resume the queue that a restart has halted."""
    with suppress(httpx.TransportError):
        httpx.post(f"{told.rig_url}/queue/actions", json={"type": "resume"}, trust_env=False)
        told.refusals["queue resumed"] += 1


def attempt(rig: RigHandle, number: int, told: Told) -> None:
    try:
        one_grip(rig, number, told)
    except Exception as error:  # noqa: BLE001 - the test reads it
        told.trouble.append(f"{number}: {type(error).__name__}: {error}")


@pytest.mark.parametrize("kills", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
def test_repeated_kills_lose_duplicate_or_misreport_no_job(
    kills: int, tmp_path: Path, figures: list[str]
) -> None:
    chance, moments = random.Random(SEED), Counter[str]()
    with running_rig(paced_rig(SHORT), tmp_path) as rig, witness(rig.rig) as seen:
        make_ready(rig, 30.0)
        assert rig.ended(rig.start_grip(labels={"key": "first"}))["state"] == "succeeded"
        begun_s, arm, killed = monotonic(), Arm(), 0
        url = rig.rig.supervisor.url
        reported = Told(f"{url}/api/v1/rigs/{rig.rig.rig.name}")
        with Supervisor(url, patience_s=PATIENCE_S) as supervisor:
            handle = supervisor.rig(rig.rig.rig.name)
            for number in range(kills):
                client = threading.Thread(target=attempt, args=(handle, number, reported))
                client.start()
                if chance.random() < PLAYING_SHARE:
                    until_playing(seen, client)
                sleep(chance.uniform(0.0, LATEST_S))
                killed_s = kill(rig, "supervisor")
                moments[phase_at(seen, killed_s)] += 1
                sleep(0.5)
                restart(rig, "supervisor")
                client.join(4.0 * PATIENCE_S)
                assert not client.is_alive(), f"seed {SEED}, round {number}"
                assert reported.trouble == [], f"seed {SEED}"
                killed = number + 1
                arm.follow(seen, begun_s)
                print(f"{killed} of {kills}, in {dict(moments)}", flush=True)
                if monotonic() - begun_s > LONGEST_S:
                    break
        checked = compared(rig, reported)
        arm.follow(seen, begun_s)
        playing = arm.played
    states = Counter(f"{job['kind']} {job['state']}" for job in reported.finals.values())
    figures.append(
        f"supervisor killed {killed} times, seed {SEED}, in {dict(moments)}: {dict(states)}, "
        f"{checked} records compared, {len(playing)} programs played, "
        f"{len(reported.bare)} of them without picture and report; "
        f"refused meanwhile {dict(reported.refusals)}"
    )
    causes = Counter(job["cause"] for job in reported.finals.values() if job["state"] == "failed")
    figures.extend(f"failed {count} times: {cause}" for cause, count in causes.most_common(5))
    begun = [job for job in reported.finals.values() if job["record"] is not None]
    assert len(playing) <= len(begun), "a program was played twice or without a job"


def until_playing(seen: Witness, client: threading.Thread) -> None:
    """Wait until a program plays, or the client has finished."""
    begun_s = monotonic()
    while client.is_alive():
        if any(view.playing for _, view in seen.since(Telemetry, begun_s)):
            return
        sleep(0.02)


def phase_at(seen: Witness, at_s: float) -> str:
    """Return the phase of the arm when the supervisor was killed."""
    views = [view for _, view in seen.since(Telemetry, at_s - 0.2)]
    return str(views[-1].phase) if views and views[-1].playing else "idle"


def compared(rig: RunningRig, told: Told) -> int:
    """Compare all replies with the journal and the records; returns the number of records."""
    jobs: list[Json] = []
    page = rig.get("/jobs", limit=500)
    jobs += [job for job in page["jobs"] if job["labels"] != {"key": "first"}]
    by_key = Counter(job["labels"].get("key") for job in jobs)
    assert {key: len(names) for key, names in told.keys.items()} == dict.fromkeys(told.keys, 1)
    assert by_key == dict.fromkeys(told.keys, 1), "a job was created without a request or twice"
    assert {job["id"] for job in jobs} == told.finals.keys()
    checked = 0
    for job in jobs:
        final = told.finals[job["id"]]
        for name in ("state", "cause", "ending", "result", "started_at", "ended_at"):
            assert job[name] == final[name], (job["id"], name)
        assert job["ended_at"] is not None
        folder = rig.data / "jobs" / job["id"]
        if not (folder / "samples.parquet").is_file():
            continue
        checked += 1
        table: Json = cast(Any, parquet).read_table(folder / "samples.parquet").to_pydict()
        written = folder / "result.json"
        if written.is_file():  # otherwise it was killed between the end and its record
            assert json.loads(written.read_text(encoding="utf-8")) == job["result"]
        elif job["state"] != "interrupted":
            told.bare.append(job["id"])
        phases = [phase for phase in table["phase"] if phase]
        assert len(table["seq"]) == len(set(table["seq"]))
        if job["state"] == "succeeded":
            assert phases[-1] in LETTING_GO, (job["id"], phases[-1])
            assert [held for held in table["held"] if held is not None][-1] is False
    return checked


class Arm:
    """Messages about the arm: only the needed ones are kept."""

    def __init__(self) -> None:
        self.played: set[int] = set()
        """Epochs in which a program has played."""
        self._last: list[Telemetry] = []

    def follow(self, seen: Witness, since_s: float) -> None:
        """Check that a part is released by a program that unloads, and that nothing trips."""
        now_s = monotonic()
        heard = [view for came_s, view in seen.since(Telemetry, since_s) if came_s < now_s]
        for before, after in pairwise(self._last + heard):
            if before.held and not after.held:
                assert after.phase in LETTING_GO or before.phase in LETTING_GO, (before, after)
        tripped = [echo.state for _, echo in seen.since(Applied, since_s) if echo.state in TRIPPED]
        assert tripped == []
        self.played |= {view.epoch for view in heard if view.playing}
        self._last = heard[-1:] or self._last
        seen.forget(now_s)
