"""What the supervisor adds to a record: picture, request, result, report, and last the manifest."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from pincette.api.job_kinds import job_kinds
from pincette.api.live import LoopTiming
from pincette.core.messages import Recorded
from pincette.records import folder as files
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.results.report import report

NOT_RECORDED = "no recorder has said what it has"


def completeness(recorded: Recorded | str) -> dict[str, bool | str]:
    """What the manifest says of a record: whether it is complete, and why not."""
    if isinstance(recorded, str):
        return {"complete": False, "detail": recorded}
    return {"complete": recorded.complete, "detail": recorded.detail}


def write_documents(
    folder: Path,
    job: JobRow,
    planned: Planned,
    *,
    result: Mapping[str, Any],
    picture: bytes,
    whose: Mapping[str, str],
    recorded: Recorded | str,
) -> None:
    """Write everything but the samples, which are the recorder's; raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    kind, state = job_kinds()[planned.plan.kind], completeness(recorded)
    files.write_bytes(folder / kind.plot, picture)
    request = {"request": job.request, "values": planned.values, "plan": job.plan}
    files.write_json(folder / files.REQUEST, request)
    files.write_json(folder / files.RESULT, result)
    page = report(
        kind=kind,
        values=planned.values,
        result=result,
        picture=picture,
        whose=whose,
        state=state,
        timing=_timing(folder),
    )
    files.write_bytes(folder / files.REPORT, page.encode())
    files.write_manifest(folder, {**whose, **state})


def _timing(folder: Path) -> LoopTiming | None:
    """What the recorder has kept of the programs' loop_timing."""
    with suppress(OSError, ValueError):
        return LoopTiming.model_validate_json((folder / files.TIMING).read_bytes())
    return None
