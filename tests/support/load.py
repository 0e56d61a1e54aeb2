"""Load test of a rig: 50 clients beside grips, with p50 and p99 of each request.

``python -m tests.support.load`` starts the demo rig in real time on ports of its own, with ended
jobs in its journal. Each client holds a stream of events, and requests live values, lists of jobs
and dry runs; two pages hold their own streams. All share one address and show no key. It prints a
table for each number of jobs, writes ``load.json`` to the folder in ``PINCETTE_FIGURES``, and fails
where a grip was disturbed.

Each client sends its requests at a fixed rate, and never two of one kind at once: a client that
waits for an answer sends its next request of that kind later. So the demand of a client has an
upper bound: 5 requests of live values, 0.5 lists and 0.1 dry runs a second.

Clients and rig share the processors, so the times include those of the clients. The row
``event loop of the clients`` says how late their own timers were, and the table of processor time
how much of the two processors each took.
"""

import argparse
import asyncio
import json
import os
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import quantiles
from time import perf_counter, process_time

import httpx
from sqlalchemy import text

from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import JOBS
from tests.bench.loop.machine import cpu_s
from tests.support.footprint import footprint
from tests.support.grips import make_ready
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig

LIVE_S, LIST_S, DRY_RUN_S, PAGE_S = 0.2, 2.0, 10.0, 1.0
"""Time between two requests of one client."""
TARGETS_S = {"list of 50 jobs": 0.05, "dry run": 0.5}
"""Greatest p50 on two quiet cores, in s."""
PAGES = 2
SETTLED = 0.3
"""Share of the time after which memory counts as settled."""
CLOCK_S = 0.05
"""Time between two looks at the lateness of the clients' event loop."""
FILLED_AT_ONCE = 500
"""Jobs added to the journal in one transaction, so that the supervisor can write meanwhile."""


@dataclass
class Measured:
    """Times and failures of the requests of all clients."""

    times_s: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    failures: Counter[str] = field(default_factory=Counter[str])


class Client:
    """One client: it has connections of its own, as a program of its own would have.

    httpx goes through all connections of a client for each request, so that 50 clients with one
    pool would take four times the processor time.
    """

    def __init__(self, url: str, rig: str, until_s: float, measured: Measured) -> None:
        self._http = httpx.AsyncClient(base_url=url, timeout=60.0, trust_env=False)
        self._rig, self._until_s, self._measured = rig, until_s, measured

    async def run(self, number: int) -> None:
        """Hold a stream of events and send requests until the time is over."""
        place = {"after": 0}

        async def live() -> None:
            found = await self._ask("live values", f"/rigs/{self._rig}/samples", dict(place))
            place["after"] = found.get("next", place["after"])

        async def jobs() -> None:
            await self._ask("list of 50 jobs", "/jobs", {"limit": 50})

        async def dry_run() -> None:
            body = {"kind": "grip", "force_mN": 8.0 + 0.1 * (number % 5), "dry_run": True}
            await self._ask("dry run", "/jobs", None, body)

        async with self._http:
            await asyncio.gather(
                self._hold("events", "/events"),
                self._each(LIVE_S, live, number),
                self._each(LIST_S, jobs, number),
                self._each(DRY_RUN_S, dry_run, number),
            )

    async def run_as_page(self) -> None:
        """Hold the two streams of a page, and request the state of the rig, until the end."""

        async def state() -> None:
            await self._ask("state of the rig", f"/rigs/{self._rig}")

        async with self._http:
            await asyncio.gather(
                self._hold("events", f"/rigs/{self._rig}/events"),
                self._hold("live", f"/rigs/{self._rig}/live"),
                self._each(PAGE_S, state, 0),
            )

    async def _each(self, every_s: float, ask: Callable[[], Awaitable[None]], number: int) -> None:
        await asyncio.sleep(every_s * (number % 10) / 10)
        while perf_counter() < self._until_s:
            begun_s = perf_counter()
            await ask()
            await asyncio.sleep(max(0.0, every_s - (perf_counter() - begun_s)))

    async def _ask(
        self, name: str, path: str, query: Json | None = None, body: Json | None = None
    ) -> Json:
        begun_s = perf_counter()
        try:
            if body is None:
                answer = await self._http.get(path, params=query)
            else:
                answer = await self._http.post(path, json=body)
        except httpx.HTTPError as error:
            self._measured.failures[f"{name}: {type(error).__name__}"] += 1
            return {}
        self._measured.times_s[name].append(perf_counter() - begun_s)
        if answer.status_code >= httpx.codes.BAD_REQUEST:
            self._measured.failures[f"{name}: {answer.status_code}"] += 1
            return {}
        return answer.json()

    async def _hold(self, name: str, path: str) -> None:
        """Hold a stream open until the time is over."""
        while (left_s := self._until_s - perf_counter()) > 0.0:
            headers = {"Accept": "text/event-stream"}
            with suppress(httpx.HTTPError, TimeoutError):
                async with asyncio.timeout(left_s):
                    async with self._http.stream("GET", path, headers=headers) as answer:
                        if answer.status_code >= httpx.codes.BAD_REQUEST:
                            self._measured.failures[f"stream of {name}: {answer.status_code}"] += 1
                            await asyncio.sleep(min(left_s, 5.0))
                        async for _ in answer.aiter_raw():
                            pass


async def clock(until_s: float, late_s: list[float]) -> None:
    """Measure how late timers of this event loop are."""
    while perf_counter() < until_s:
        begun_s = perf_counter()
        await asyncio.sleep(CLOCK_S)
        late_s.append(perf_counter() - begun_s - CLOCK_S)


async def clients(url: str, rig: str, until_s: float, count: int) -> Measured:
    """Run clients and pages until the time is over."""
    measured = Measured()
    many = [Client(url, rig, until_s, measured) for _ in range(count + PAGES)]
    tasks = [one.run(number) for number, one in enumerate(many[:count])]
    tasks += [one.run_as_page() for one in many[count:]]
    await asyncio.gather(*tasks, clock(until_s, measured.times_s["event loop of the clients"]))
    return measured


async def grips(rig: RunningRig, count: int, until_s: float) -> list[Json]:
    """Start grips at equal distances; returns the jobs as they ended."""
    ended: list[Json] = []
    for number in range(count):
        job = await asyncio.to_thread(rig.start_grip)
        ended.append(await asyncio.to_thread(rig.ended, job))
        left_s = until_s - perf_counter()
        await asyncio.sleep(max(0.0, left_s / (count - number)) if number + 1 < count else 0.0)
    return ended


def fill(journal: Path, count: int) -> None:
    """Add ended jobs to a journal, as copies of its newest one."""
    names = [column.name for column in JOBS.columns]
    own = {"id": "printf('filled-%08d', n)", "number": "n"}
    adding = text(
        "WITH RECURSIVE added(n) AS "
        "(SELECT :first UNION ALL SELECT n + 1 FROM added WHERE n < :last) "
        f"INSERT INTO {JOBS.name} ({', '.join(names)}) "
        f"SELECT {', '.join(own.get(name, name) for name in names)} "
        f"FROM {JOBS.name}, added WHERE number = :newest"
    )
    store = Store(journal)
    (newest,) = store.newest(1)
    end = newest.number + count
    for first in range(newest.number + 1, end + 1, FILLED_AT_ONCE):
        with store.writing() as connection:
            last = min(first + FILLED_AT_ONCE - 1, end)
            connection.execute(adding, {"first": first, "last": last, "newest": newest.number})
    store.close()


async def measure(rig: RunningRig, given: argparse.Namespace, jobs: int) -> Json:
    """Load a rig that is ready; returns the figures."""
    until_s = perf_counter() + given.seconds
    name = rig.rig.rig.name
    process = rig.fleet.members["supervisor"].process.pid
    memory_kB: list[int] = []

    async def watch() -> None:
        while perf_counter() < until_s:
            memory_kB.append(footprint(process)["memory_kB"])
            await asyncio.sleep(min(5.0, given.seconds / 20.0))

    before = rig.get(f"/rigs/{name}/timing")["programs"]
    begun_s, used_s = perf_counter(), processor_times_s(rig)
    measured, _, ended = await asyncio.gather(
        clients(str(rig.client.base_url), name, until_s, given.clients),
        watch(),
        grips(rig, given.grips, until_s),
    )
    took_s = perf_counter() - begun_s
    shares = {who: (end_s - used_s[who]) / took_s for who, end_s in processor_times_s(rig).items()}
    after = rig.get(f"/rigs/{name}/timing")["programs"]
    requests = {requested: spread(values) for requested, values in sorted(measured.times_s.items())}
    return {
        "clients": given.clients,
        "seconds": given.seconds,
        "jobs_in_journal": jobs,
        "processors": os.cpu_count(),
        "requests": requests,
        "failures": dict(measured.failures),
        "processors_used": shares,
        "grips": dict(Counter(str(job["state"]) for job in ended)),
        "missed_ticks": sum(job["result"]["missed_ticks"] for job in ended if job["result"]),
        "missed": {one["program"]: one["missed"] for one in after},
        "missed_before": {one["program"]: one["missed"] for one in before},
        "supervisor_MB": {
            "begin": memory_kB[0] / 1e3,
            "settled": memory_kB[int(SETTLED * len(memory_kB))] / 1e3,
            "end": memory_kB[-1] / 1e3,
        },
    }


def processor_times_s(rig: RunningRig) -> dict[str, float]:
    """Return the processor time so far of supervisor, its processes, other programs and clients."""
    programs = {name: member.process.pid for name, member in rig.fleet.members.items()}
    supervisor = programs.pop("supervisor")
    return {
        "supervisor": cpu_s(supervisor),
        "processes of the supervisor": sum(map(cpu_s, children(supervisor))),
        "other programs of the rig": sum(map(cpu_s, programs.values())),
        "clients": process_time(),
    }


def children(process: int) -> list[int]:
    """Return the processes that threads of a process have started."""
    lists = Path(f"/proc/{process}/task").glob("*/children")
    return [int(word) for one in lists for word in one.read_text(encoding="ascii").split()]


def spread(values: Sequence[float]) -> Json:
    """Return count, p50 and p99 of times in s."""
    cuts = quantiles(values, n=100) if len(values) > 1 else [*values] * 99
    return {"count": len(values), "p50_s": cuts[49], "p99_s": cuts[98]}


def table(found: Json) -> str:
    """Return the figures for people."""
    rows = [
        f"{found['clients']} clients, {found['seconds']:g} s, {found['jobs_in_journal']} ended "
        f"jobs in the journal, {found['processors']} processors",
        "",
        "| request | count | p50 / ms | p99 / ms | target for p50 / ms |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, one in found["requests"].items():
        target = f"{1e3 * TARGETS_S[name]:g}" if name in TARGETS_S else ""
        times = f"{1e3 * one['p50_s']:.1f} | {1e3 * one['p99_s']:.1f}"
        rows.append(f"| {name} | {one['count']} | {times} | {target} |")
    memory = found["supervisor_MB"]
    rows += [
        "",
        *(f"{who}: {share:.2f} processors" for who, share in found["processors_used"].items()),
        f"grips: {found['grips']}, missed ticks in them: {found['missed_ticks']}",
        f"resident memory of the supervisor: {memory['begin']:.0f} MB at the start, "
        f"{memory['settled']:.0f} MB settled, {memory['end']:.0f} MB at the end",
        f"refused or failed: {found['failures'] or 'none'}",
    ]
    return "\n".join(rows)


def main(words: Sequence[str] | None = None) -> int:
    """Run the load test; returns the exit status."""
    parser = argparse.ArgumentParser(description="load a rig with many honest clients")
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--grips", type=int, default=30)
    parser.add_argument(
        "--jobs",
        type=int,
        nargs="+",
        default=[5000, 50_000],
        help="ended jobs in the journal; one run for each number",
    )
    given = parser.parse_args(words)
    runs: list[Json] = []
    for jobs in given.jobs:
        runs.append(loaded(given, jobs))
        print(table(runs[-1]), end="\n\n", flush=True)
    if figures := os.environ.get("PINCETTE_FIGURES"):
        text = json.dumps(runs, indent=1)
        (Path(figures) / "load.json").write_text(f"{text}\n", encoding="utf-8")
    disturbed = [one["grips"] for one in runs if one["grips"].keys() != {"succeeded"}]
    if disturbed:
        print(f"grips were disturbed: {disturbed}", file=sys.stderr)
    return int(bool(disturbed))


def loaded(given: argparse.Namespace, jobs: int) -> Json:
    """Start a rig with ended jobs in its journal, load it, and return the figures."""
    rig_file = demo_rig({"supervisor": {"clients_per_address": given.clients}})
    with (
        tempfile.TemporaryDirectory(prefix="pincette-load-") as folder,
        running_rig(rig_file, Path(folder)) as rig,
    ):
        make_ready(rig)
        rig.ended(rig.start_grip())
        fill(rig.data / "supervisor.sqlite", jobs)
        return asyncio.run(measure(rig, given, jobs))


if __name__ == "__main__":
    sys.exit(main())
