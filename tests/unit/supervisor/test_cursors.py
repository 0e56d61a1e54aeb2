"""Lists that are longer than a page are read to their end."""

import asyncio
from typing import Any

import httpx
import pytest

from pincette.api.access import AuditEntry, AuditList
from pincette.client.supervisor import AsyncSupervisor
from pincette_supervisor.journal.library import (
    LearnedRepository,
    LearnedRow,
    RecipeRepository,
    TrajectoryRepository,
    TrajectoryRow,
)
from pincette_supervisor.journal.series import SeriesRepository, SeriesRow
from pincette_supervisor.journal.store import Store
from tests.support.apps import create_app

from . import samples
from .harness import Harness


def test_trajectories_are_listed_page_by_page(store: Store) -> None:
    book = TrajectoryRepository(store)
    rows = [book.add(TrajectoryRow("demo", {"n": n}, "f", 1, "m"))[0] for n in range(7)]
    found: list[TrajectoryRow] = []
    while page := book.newest(3, found[-1] if found else None):
        found += page
    assert len(found) == 7
    assert {row.digest for row in found} == {row.digest for row in rows}


class Pages:
    """A transport to an audit log of 1200 entries, in pages of at most 500."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    async def send(self, call: Any) -> AuditList:
        limit, before = call.query["limit"], call.query.get("before", 1201)
        assert 1 <= limit <= 500
        self.asked.append(limit)
        numbers = range(before - 1, max(0, before - 1 - limit), -1)
        entries = [AuditEntry.model_construct(number=number) for number in numbers]
        last = numbers[-1]
        return AuditList.model_construct(entries=entries, next=last if last > 1 else None)


def test_the_client_reads_as_many_pages_as_it_needs() -> None:
    for limit, wanted in ((600, 600), (1200, 1200), (5000, 1200), (1, 1)):
        supervisor = AsyncSupervisor.__new__(AsyncSupervisor)
        supervisor.transport = Pages()  # pyright: ignore[reportAttributeAccessIssue]
        entries = asyncio.run(supervisor.audit(limit))
        assert [entry.number for entry in entries] == list(range(1200, 1200 - wanted, -1))


def read(harness: Harness, path: str, member: str, name: str, size: int) -> list[str]:
    """Read a list to its end in pages of a size; return what names its entries."""
    found: list[str] = []
    query: dict[str, Any] = {}
    while True:
        page = harness.get(path, limit=size, **query)
        names = [str(row[name]) for row in page[member]]
        assert 1 <= len(names) <= size
        found += names
        if page["next"] is None:
            return found
        assert page["next"] == names[-1]
        query = {"before": page["next"]}


def kept_recipes(harness: Harness) -> list[str]:
    repository = RecipeRepository(harness.store)
    for number in range(7):
        repository.add(f"bead-{number}", {"force_mN": 5.0}, "")
    repository.add("bead-3", {"force_mN": 6.0}, "")
    return [f"bead-{number}" for number in range(7)]


def learned_programs(harness: Harness) -> list[str]:
    repository = LearnedRepository(harness.store, harness.manager.name)
    names = [f"{number:016x}" for number in range(7)]
    for number, name in enumerate(names):
        at = f"2026-03-01T12:00:0{number}.000Z"
        repository.keep(LearnedRow(name, "j", at, {}, (0.1,), (0.2,)))
    return names[::-1]


def kept_trajectories(harness: Harness) -> list[str]:
    repository = TrajectoryRepository(harness.store)
    rows = [
        repository.add(TrajectoryRow("demo", {"kind": "grip", "n": number}, "f", 1, "m"))[0]
        for number in range(7)
    ]
    # The newest first, and by digest where two are of the same millisecond.
    rows.sort(key=lambda row: row.digest)
    rows.sort(key=lambda row: row.created_at, reverse=True)
    return [row.digest for row in rows]


def succeeded_calibrations(harness: Harness) -> list[str]:
    harness.bus.edit = lambda ticks: samples.rest(ticks[0].position.epoch, 0.03)
    return [str(harness.calibrated()["id"]) for _ in range(3)][::-1]


def kept_series(harness: Harness) -> list[str]:
    repository = SeriesRepository(harness.store)
    for number in range(4):
        row = SeriesRow(f"s{number}", "demo", "", "completed", {}, [], "2026-03-01T12:00:00.000Z")
        repository.add(row)
    return ["s3", "s2", "s1", "s0"]


LISTS: dict[str, Any] = {
    "/series": ("series", "id", kept_series),
    "/recipes": ("recipes", "name", kept_recipes),
    "/rigs/demo/learning": ("programs", "program", learned_programs),
    "/trajectories": ("trajectories", "digest", kept_trajectories),
    "/calibrations": ("calibrations", "id", succeeded_calibrations),
}


@pytest.mark.parametrize("path", LISTS)
def test_every_list_is_read_page_by_page(path: str, harness: Harness) -> None:
    member, name, fill = LISTS[path]
    wanted = fill(harness)
    for size in (1, 2, len(wanted) - 1, len(wanted), 500):
        assert read(harness, path, member, name, size) == wanted
    rows = harness.get(path)[member]
    assert [row[name] for row in rows] == wanted
    for limit in (0, 501, "all"):
        assert harness.call("GET", f"/api/v1{path}?limit={limit}").status_code == 422


@pytest.mark.parametrize(
    "path", ["/trajectories", "/calibrations", "/rigs/demo/learning", "/series"]
)
def test_an_unknown_cursor_is_not_found(path: str, harness: Harness) -> None:
    answer = harness.call("GET", f"/api/v1{path}?before={'0' * 16}")
    assert answer.status_code == 404, answer.text


def test_the_client_reads_all_pages_of_recipes_and_learned_programs(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("supervisor", "rig"):
        monkeypatch.setattr(f"pincette.client.{module}.PAGE", 3)
    names, programs = kept_recipes(harness), learned_programs(harness)

    async def read_all() -> tuple[list[str], list[str]]:
        transport = httpx.ASGITransport(create_app(harness.rigs))
        async with AsyncSupervisor("http://localhost", transport=transport) as supervisor:
            recipes = await supervisor.recipes()
            learned = await (await supervisor.rig("demo")).learning()
        assert {row.name: row.version for row in recipes}["bead-3"] == 2
        return [row.name for row in recipes], [row.program for row in learned.programs]

    assert asyncio.run(read_all()) == (names, programs)
