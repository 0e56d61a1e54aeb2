"""Clients that send a supervisor as many requests as they can: ``python -m tests.support.hammer API
RIG CLIENTS``.

They read old jobs and their files, plan, and read the state of the rig, repeatedly with a short
pause, until standard input closes. Then one line of JSON states the outcome.
"""

import asyncio
import json
import random
import subprocess
import sys
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import monotonic
from typing import cast

import httpx
import numpy as np

from tests.support.running import Json, RunningRig

PAUSE_S = 0.1
"""Mean pause of a client between a reply and its next request, in s."""
WAIT_S = 30.0
SEED = 20131


@dataclass
class Tally:
    """Counts and times of the requests."""

    statuses: Counter[int] = field(default_factory=Counter[int])
    took_s: list[float] = field(default_factory=list[float])

    def told(self) -> Json:
        """Return it as JSON values."""
        p50, p99 = (float(value) for value in np.percentile(self.took_s or [0.0], (50.0, 99.0)))
        answers = {str(status): count for status, count in self.statuses.items()}
        return {"asked": len(self.took_s), "answers": answers, "p50_s": p50, "p99_s": p99}


def questions(rig: str, job: str) -> list[tuple[str, str, Json | None]]:
    """Return the requests that a client may send; a plan is computed, a record is read."""
    plan = {"kind": "grip"}
    return [
        ("GET", f"/rigs/{rig}", None),
        ("GET", "/jobs?limit=100", None),
        ("GET", f"/jobs/{job}", None),
        ("GET", f"/jobs/{job}/artifacts", None),
        ("GET", f"/jobs/{job}/artifacts/samples.parquet", None),
        ("GET", f"/jobs/{job}/artifacts/grip.png", None),
        ("GET", f"/jobs/{job}/events/list", None),
        ("POST", "/jobs?dry_run=true", plan),
    ]


async def client(
    line: httpx.AsyncClient, rig: str, seed: int, end: asyncio.Event, tally: Tally
) -> None:
    """Run one client until the end."""
    chance = random.Random(seed)
    jobs = [job["id"] for job in (await line.get("/jobs")).json()["jobs"] if job["ended_at"]]
    while not end.is_set():
        method, path, body = chance.choice(questions(rig, chance.choice(jobs)))
        asked_s = monotonic()
        answer = await line.request(method, path, json=body)
        tally.took_s.append(monotonic() - asked_s)
        tally.statuses[answer.status_code] += 1
        await asyncio.sleep(chance.uniform(0.0, 2.0 * PAUSE_S))


async def hammer(api: str, rig: str, clients: int) -> Tally:
    """Run clients until standard input closes."""
    tally, end = Tally(), asyncio.Event()
    limits = httpx.Limits(max_connections=clients, max_keepalive_connections=clients)
    async with (
        httpx.AsyncClient(base_url=api, timeout=WAIT_S, limits=limits, trust_env=False) as line,
        asyncio.TaskGroup() as group,
    ):
        for number in range(clients):
            group.create_task(client(line, rig, SEED + number, end, tally))
        await asyncio.to_thread(sys.stdin.read)
        end.set()
    return tally


@contextmanager
def hammered(rig: RunningRig, clients: int) -> Generator[Json]:
    """Run clients for the duration of the block; then the tally holds the outcome."""
    words = [sys.executable, "-m", "tests.support.hammer"]
    words += [str(rig.client.base_url), rig.rig.rig.name, str(clients)]
    process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    tally: Json = {}
    try:
        yield tally
    finally:
        output, _ = process.communicate(timeout=10 * WAIT_S)
    tally.update(cast(Json, json.loads(output)))


if __name__ == "__main__":
    print(json.dumps(asyncio.run(hammer(sys.argv[1], sys.argv[2], int(sys.argv[3]))).told()))
