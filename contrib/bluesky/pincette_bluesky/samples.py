"""Samples of a record as pages of events."""

import asyncio
import math
from collections.abc import AsyncGenerator
from datetime import datetime
from pathlib import Path
from typing import Any

from event_model.documents.event_page import PartialEventPage

from pincette.client import AsyncJobHandle
from pincette.core.files import temporary_folder
from pincette_bluesky.readings import SAID, columns

ROWS = 1000
"""Largest number of events in a page."""
RECORD = "samples.parquet"


async def pages(job: AsyncJobHandle, name: str, arms: int) -> AsyncGenerator[PartialEventPage]:
    """Yield the samples of a job; their times are counted from sample 0.

    Records of earlier versions do not contain the time of sample 0; the start of the job is used
    instead.
    """
    with temporary_folder() as folder:
        path = await job.download(RECORD, folder)
        found, sample_0_at = await asyncio.to_thread(_read, path, columns(arms))
    begin_at = sample_0_at or job.job.started_at
    begin_s = 0.0 if begin_at is None else datetime.fromisoformat(begin_at).timestamp()
    times = [begin_s + t_s for t_s in found["t_s"]]
    for first in range(0, len(times), ROWS):
        part = slice(first, first + ROWS)
        data = {f"{name}-{field}": found[field][part] for field in columns(arms)}
        stamps = dict.fromkeys(data, times[part])
        yield PartialEventPage(data=data, timestamps=stamps, time=times[part])


def _read(path: Path, wanted: tuple[str, ...]) -> tuple[dict[str, list[Any]], str | None]:
    """Read columns, and the time of sample 0."""
    # Imported when the first record is read; the package has no type annotations.
    import pyarrow.parquet

    parquet: Any = pyarrow.parquet
    table = parquet.read_table(path, columns=list(wanted))
    found = {
        field: [_known(value, field) for value in table[field].to_pylist()] for field in wanted
    }
    about: dict[bytes, bytes] = table.schema.metadata or {}
    sample_0_at = about.get(b"sample_0_at")
    return found, None if sample_0_at is None else sample_0_at.decode()


def _known(value: Any, field: str) -> Any:
    if value is None:
        return "" if field in SAID else math.nan
    return value
