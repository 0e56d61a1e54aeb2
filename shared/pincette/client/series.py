"""A series of jobs of a supervisor, over asyncio."""

import sys
from collections.abc import Mapping
from typing import Any, Literal
from uuid import uuid4

from pincette.api.series import (
    SERIES_LABEL,
    Series,
    SeriesActionType,
    SeriesList,
    SeriesPlan,
    SeriesRequest,
    SeriesState,
    SeriesSummary,
)
from pincette.client.call import PLANNING_S, Call, content, get, model, post
from pincette.client.errors import WaitTimeoutError
from pincette.client.job import LONGEST_WAIT_S, PAGE, AsyncJobHandle, jobs
from pincette.client.transport import Transport


class AsyncSeriesHandle:
    """One series: its state, its actions, its jobs and its report."""

    def __init__(self, transport: Transport, series: Series) -> None:
        self._transport = transport
        self.series = series
        """State of the series in the newest reply of the supervisor."""

    @property
    def id(self) -> str:
        """Identifier of the series."""
        return self.series.id

    @property
    def state(self) -> SeriesState:
        """State of the series in the newest reply; ``refresh`` requests a new one."""
        return self.series.state

    def __repr__(self) -> str:
        known = self.series
        return f"<series {known.id}: {known.state}, {known.ended} of {known.total} jobs ended>"

    def patient(self, patience_s: float) -> "AsyncSeriesHandle":
        """Return a copy of this series that retries for this time, in s, when no supervisor
        replies.
        """
        return AsyncSeriesHandle(self._transport.patient(patience_s), self.series)

    async def refresh(self, wait_s: float = 0.0) -> Series:
        """Request the state of the series; with ``wait_s``, wait up to this time until it is not
        running.
        """
        query: dict[str, str | float] = {"wait": "over", "timeout_s": wait_s} if wait_s else {}
        call = Call("GET", self._path, model(Series), query, repeatable=True, kept_s=wait_s)
        return self._update(await self._transport.send(call))

    async def wait(self, timeout_s: float | None = None) -> Series:
        """Wait until the series is paused, stopped or completed.

        Raises WaitTimeoutError after ``timeout_s``.
        """
        clock = self._transport.clock
        until_s = None if timeout_s is None else clock() + timeout_s
        while self.state == "running":
            left_s = LONGEST_WAIT_S if until_s is None else until_s - clock()
            if left_s <= 0.0:
                raise WaitTimeoutError(
                    f"series {self.id} is running after {timeout_s:g} s, and continues"
                )
            await self.refresh(min(left_s, LONGEST_WAIT_S))
        return self.series

    async def pause(self) -> Series:
        """Pause the series: no further job starts; the running one continues."""
        return await self.act("pause")

    async def resume(self) -> Series:
        """Resume the series with the next job."""
        return await self.act("resume")

    async def stop(self) -> Series:
        """Stop the series and its running job; a held part stays held."""
        return await self.act("stop")

    async def act(self, action: SeriesActionType) -> Series:
        """Request an action by its name."""
        call = post(f"{self._path}/actions", Series, {"type": action}, repeatable=True)
        return self._update(await self._transport.send(call))

    async def jobs(self) -> list[AsyncJobHandle]:
        """Return the jobs that the series has started, newest first."""
        label = f"{SERIES_LABEL}={self.id}"
        # Interrupted jobs are repeated, so the number of jobs has no bound.
        return await jobs(self._transport, sys.maxsize, label=label)

    async def table(self, form: Literal["csv", "parquet"] = "csv") -> bytes:
        """Return the jobs of the series as one table, newest first."""
        query: dict[str, str | float] = {"label": f"{SERIES_LABEL}={self.id}"}
        call = Call("GET", f"/jobs/export.{form}", content, query, repeatable=True)
        return await self._transport.send(call)

    async def report(self) -> bytes:
        """Return the report of the series as an HTML page that needs no other file."""
        return await self._transport.send(
            Call("GET", f"{self._path}/report", content, repeatable=True)
        )

    async def picture(self) -> bytes:
        """Return the figure of the report as PNG."""
        return await self._transport.send(
            Call("GET", f"{self._path}/plot", content, repeatable=True)
        )

    @property
    def _path(self) -> str:
        return f"/series/{self.id}"

    def _update(self, series: Series) -> Series:
        self.series = series
        return series


async def started(
    transport: Transport,
    rig: str,
    request: SeriesRequest | None,
    key: str | None,
    headers: Mapping[str, str],
    **fields: Any,
) -> AsyncSeriesHandle:
    """Start a series exactly once."""
    key = key or uuid4().hex
    call = Call(
        "POST",
        "/series",
        model(Series),
        body=_body(rig, request, fields),
        headers={"Idempotency-Key": key, **headers},
        repeatable=True,
        kept_s=PLANNING_S,
        look=f"`pincette series list` shows it; sent again with Idempotency-Key {key} it creates "
        "no second series",
    )
    return AsyncSeriesHandle(transport, await transport.send(call))


async def planned(
    transport: Transport, rig: str, request: SeriesRequest | None, **fields: Any
) -> SeriesPlan:
    """Plan and predict all jobs of a series; nothing moves."""
    body = {**_body(rig, request, fields), "dry_run": True}
    call = Call("POST", "/series", model(SeriesPlan), body=body, repeatable=True, kept_s=PLANNING_S)
    return await transport.send(call)


def _body(rig: str, request: SeriesRequest | None, fields: dict[str, Any]) -> dict[str, Any]:
    given = {} if request is None else request.model_dump(mode="json", exclude_unset=True)
    return {**given, **fields, "rig": rig}


async def listed(transport: Transport, limit: int, rig: str | None = None) -> list[SeriesSummary]:
    """Return series, newest first."""
    found: list[SeriesSummary] = []
    before: str | None = None
    while len(found) < limit:
        size = min(PAGE, limit - len(found))
        page = await transport.send(get("/series", SeriesList, limit=size, rig=rig, before=before))
        found += page.series
        if (before := page.next) is None:
            break
    return found
