"""Lists that are longer than a page are read to their end."""

import asyncio
from contextlib import closing
from pathlib import Path
from typing import Any

from pincette.api.access import AuditEntry, AuditList
from pincette.client.supervisor import AsyncSupervisor
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.trajectories import TrajectoryRepository, TrajectoryRow


def test_trajectories_are_listed_page_by_page(tmp_path: Path) -> None:
    with closing(Store(tmp_path / "jobs.sqlite")) as store:
        book = TrajectoryRepository(store)
        rows = [book.add(TrajectoryRow("demo", {"n": n}, "f", 1, "m"))[0] for n in range(7)]
        found: list[TrajectoryRow] = []
        while page := book.newest(3, found[-1] if found else None):
            found += page
    assert len(found) == 7
    assert {row.digest for row in found} == {row.digest for row in rows}


class Pages:
    """A transport to an audit log of 1200 entries, in pages of 500 at most."""

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


def test_the_client_reads_page_after_page() -> None:
    for limit, wanted in ((600, 600), (1200, 1200), (5000, 1200), (1, 1)):
        supervisor = AsyncSupervisor.__new__(AsyncSupervisor)
        supervisor.transport = Pages()  # pyright: ignore[reportAttributeAccessIssue]
        entries = asyncio.run(supervisor.audit(limit))
        assert [entry.number for entry in entries] == list(range(1200, 1200 - wanted, -1))
