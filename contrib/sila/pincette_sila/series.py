"""A series of grips from its request to its end, as an observable command of SiLA."""

import asyncio
from datetime import timedelta
from typing import Any, NamedTuple

from sila2.server import ObservableCommandInstanceWithIntermediateResponses

from pincette.client import AsyncSeriesHandle, JobWaitsError
from pincette.client.call import PATIENCE_S
from pincette_sila.callers import Callers
from pincette_sila.errors import CommandError

LOOK_S = 0.25
"""Interval at which the progress of a series is read, in s."""


class Progress(NamedTuple):
    """Progress of a series; the fields are those of the feature definition."""

    Ended: int
    Failed: int
    Job: str


async def followed(
    series: AsyncSeriesHandle,
    execution: ObservableCommandInstanceWithIntermediateResponses[Any],
    callers: Callers,
) -> tuple[str, int, int]:
    """Report the progress of a series until it has completed; return its responses.

    Raises
    ------
    JobWaitsError
        If a job of the series waits for a decision.
    CommandError
        If the series was stopped: by a caller, as for a single job, or by its stop rule.
    """
    last: Progress | None = None
    while True:
        known = await series.patient(PATIENCE_S).refresh()
        now = Progress(known.ended, known.failed, known.job or "")
        execution.progress = known.ended / known.total
        if known.remaining_s is not None:
            execution.estimated_remaining_time = timedelta(seconds=known.remaining_s)
        if now != last:
            execution.send_intermediate_response(now)
            last = now
        if known.state == "completed":
            return series.id, known.ended, known.failed
        if known.state == "stopped":
            states = [one.state for one in known.jobs if one.state is not None]
            code = "JobFailed" if states[-1:] == ["failed"] else "Cancelled"
            raise CommandError(code, f"series {series.id} is stopped: {known.cause}")
        if known.job is not None:
            job = (await callers.supervisor.patient(PATIENCE_S).job(known.job)).job
            if job.recovery is not None:
                words = f"series {series.id}, job {job.id}: {job.cause}"
                raise JobWaitsError(f"{words}; it waits for a decision", job)
        await asyncio.sleep(LOOK_S)
