"""A supervisor, and access to its rigs and jobs, over asyncio."""

from collections.abc import AsyncGenerator, Sequence
from copy import copy
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import httpx

from pincette.api.access import AuditChain, AuditEntry, AuditList, Session
from pincette.api.calibrations import Proposal, ProposalList
from pincette.api.events import Alarm, AlarmList, Event
from pincette.api.jobs import Job
from pincette.api.requests import Recipe, RecipeHistory, RecipeList
from pincette.api.rigs import Rig, RigList, StoppedList
from pincette.api.series import Series, SeriesSummary
from pincette.client.call import PATIENCE_S, Call, content, get, post
from pincette.client.errors import WhichRigError
from pincette.client.job import PAGE, AsyncJobHandle, jobs
from pincette.client.rig import AsyncRigHandle, events, stop
from pincette.client.series import AsyncSeriesHandle, listed
from pincette.client.transport import AsyncConnection, Transport, client_settings

TIMEOUT_S = 10.0
"""Default time limit for each reply, in s."""

ExportForm = Literal["csv", "parquet", "numbers.csv", "numbers.csv-metadata.json"]


class AsyncSupervisor:
    """Entry point: ``AsyncSupervisor(url).rig()``.

    Parameters
    ----------
    url
        Address of the supervisor, such as ``http://127.0.0.1:8000``.
    timeout_s
        Time limit for each reply, in s.
    patience_s
        Time for which repeatable calls are retried when no supervisor replies, in s.
    operator
        Name that is stored with every action; if omitted, the supervisor stores the address.
    key
        Key for a supervisor that requires one; the supervisor then stores the key's name.
    authority
        File of a certificate that is trusted over ``https://``, in addition to those of this
        machine: ``authority.crt`` of ``pincette security``.
    claim
        Secret of at least 16 characters, chosen by the caller: ``rig.claim`` claims a rig with it,
        and every call sends it.
    transport
        Replacement of the network, as in tests.

    Raises
    ------
    ClientError
        ``url`` is not an address, or ``authority`` cannot be read.
    ValueError
        ``operator`` or ``key`` cannot be sent in a header.
    """

    def __init__(
        self,
        url: str,
        *,
        timeout_s: float = TIMEOUT_S,
        patience_s: float = PATIENCE_S,
        operator: str | None = None,
        key: str | None = None,
        claim: str | None = None,
        authority: Path | None = None,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        settings = client_settings(url, operator, key, authority, claim)
        connection = AsyncConnection(httpx.AsyncClient(**settings, transport=transport))
        self.transport = Transport(url, connection, timeout_s, patience_s)
        """Object that sends the calls; its clock and its sleep may be replaced."""

    def __repr__(self) -> str:
        return f"<supervisor {self.transport.url}>"

    async def __aenter__(self) -> "AsyncSupervisor":
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close every connection."""
        await self.transport.close()

    def patient(self, patience_s: float) -> "AsyncSupervisor":
        """Return a copy of this supervisor that retries for this time, in s, when it does not
        reply.
        """
        other = copy(self)
        other.transport = self.transport.patient(patience_s)
        return other

    def within(self, timeout_s: float) -> "AsyncSupervisor":
        """Return a copy of this supervisor with another time limit for each reply, in s."""
        other = copy(self)
        other.transport = self.transport.within(timeout_s)
        return other

    async def rigs(self) -> list[Rig]:
        """Return every rig that the supervisor serves."""
        return (await self.transport.send(get("/rigs", RigList))).rigs

    async def rig(self, name: str | None = None) -> AsyncRigHandle:
        """Return a rig by its name; raises WhichRigError if no name is given and there are
        several.
        """
        return AsyncRigHandle(self.transport, name or _only(await self.rigs()))

    async def job(self, name: str) -> AsyncJobHandle:
        """Return a job of any rig by its identifier."""
        found = await self.transport.send(get(f"/jobs/{name}", Job))
        return AsyncJobHandle(self.transport, found)

    async def stop(self, idempotency_key: str) -> Job | None:
        """Stop the job of an idempotency key of ``start``, and return it; None if there is none.

        In both cases the key cannot create a job after that.
        """
        return await stop(self.transport, idempotency_key)

    async def jobs(self, limit: int = 50, **filters: str | int) -> list[AsyncJobHandle]:
        """Return jobs of every rig, newest first.

        Filters are rig, state, kind, outcome, label (``name=value``), text, created_from,
        created_to (ISO 8601 with a time zone), and before (a job's id).
        """
        return await jobs(self.transport, limit, **filters)

    async def find_series(self, name: str) -> AsyncSeriesHandle:
        """Return a series of any rig by its identifier."""
        found = await self.transport.send(get(f"/series/{name}", Series))
        return AsyncSeriesHandle(self.transport, found)

    async def series(self, limit: int = 50, rig: str | None = None) -> list[SeriesSummary]:
        """Return the series of every rig, or of one rig, newest first."""
        return await listed(self.transport, limit, rig)

    async def export(self, form: ExportForm = "csv", **filters: str | int) -> bytes:
        """Return many jobs as one table, by the filters of ``jobs``.

        ``numbers.csv`` contains only numbers; ``numbers.csv-metadata.json`` describes its columns.
        """
        call = Call("GET", f"/jobs/export.{form}", content, filters, repeatable=True)
        return await self.transport.send(call)

    def events(self, after: int | None = None) -> AsyncGenerator[Event]:
        """Yield the events of every rig as they arrive, from after a given number.

        Without a number, yield only new events.
        """
        return events(self.transport, "/events", after)

    async def estop(self) -> StoppedList:
        """Stop every rig at once; raises ProblemError that names a rig which did not confirm."""
        return await self.transport.send(post("/estop", StoppedList, repeatable=True))

    async def proposals(self, limit: int = 50) -> list[Proposal]:
        """Return the proposals of calibrations, newest first."""
        found: list[Proposal] = []
        before: str | None = None
        while len(found) < limit:
            size = min(PAGE, limit - len(found))
            call = get("/calibrations", ProposalList, limit=size, before=before)
            page = await self.transport.send(call)
            found += page.calibrations
            if (before := page.next) is None:
                break
        return found

    async def proposal(self, calibration: str) -> Proposal:
        """Return the proposal of one calibration, with the values in use."""
        return await self.transport.send(get(f"/calibrations/{calibration}", Proposal))

    async def decide(self, calibration: str, decision: Literal["accept", "discard"]) -> Proposal:
        """Accept or discard the proposal of a calibration."""
        call = post(f"/calibrations/{calibration}/actions", Proposal, {"type": decision})
        return await self.transport.send(call)

    async def recipes(self) -> list[Recipe]:
        """Return the newest version of every recipe, by name."""
        found: list[Recipe] = []
        before: str | None = None
        while True:
            call = get("/recipes", RecipeList, limit=PAGE, before=before)
            page = await self.transport.send(call)
            found += page.recipes
            if (before := page.next) is None:
                return found

    async def recipe(self, name: str) -> RecipeHistory:
        """Return one recipe with all its versions."""
        return await self.transport.send(get(f"/recipes/{name}", RecipeHistory))

    async def save_recipe(self, name: str, values: dict[str, Any], note: str = "") -> Recipe:
        """Save values under a name, as the next version of that recipe."""
        body = {"name": name, "values": values, "note": note}
        return await self.transport.send(post("/recipes", Recipe, body, repeatable=True))

    async def alarms(
        self,
        limit: int = 50,
        *,
        rig: str | None = None,
        open: bool | None = None,  # noqa: A002 - the name of the query over REST
        before: int | None = None,
    ) -> AlarmList:
        """Return alarms, newest first.

        They can be limited to one rig, to open alarms, or to those before a number.
        """
        only = None if open is None else str(open).lower()
        found: list[Alarm] = []
        while True:
            size = max(1, min(PAGE, limit - len(found)))
            call = get("/alarms", AlarmList, rig=rig, open=only, limit=size, before=before)
            page = await self.transport.send(call)
            found += page.alarms
            before = page.next
            if before is None or len(found) >= limit:
                return page.model_copy(update={"alarms": found})

    async def acknowledge(self, alarm: int) -> Alarm:
        """Acknowledge an alarm that a person has seen; repeating it changes nothing."""
        path, body = f"/alarms/{alarm}/actions", {"type": "acknowledge"}
        return await self.transport.send(post(path, Alarm, body, repeatable=True))

    async def session(self) -> Session:
        """Return the caller's identity and permissions, as determined by the supervisor."""
        return await self.transport.send(get("/session", Session))

    async def audit(self, limit: int = 50, before: int | None = None) -> list[AuditEntry]:
        """Return requests that changed something, newest first.

        With ``before``, only entries with a lower number are returned.
        """
        found: list[AuditEntry] = []
        while len(found) < limit:
            size = min(PAGE, limit - len(found))
            page = await self.transport.send(get("/audit", AuditList, limit=size, before=before))
            found += page.entries
            if (before := page.next) is None:
                break
        return found

    async def audit_chain(self, link: str | None = None) -> AuditChain:
        """Return whether the audit log is intact and still contains a link that was noted
        earlier.
        """
        return await self.transport.send(get("/audit/chain", AuditChain, link=link))


def _only(rigs: Sequence[Rig]) -> str:
    names = [rig.name for rig in rigs]
    if len(names) != 1:
        there = ", ".join(names) or "none"
        raise WhichRigError(
            f"which rig is meant? The supervisor serves {len(names)}: {there}. Name one of them"
        )
    return names[0]
