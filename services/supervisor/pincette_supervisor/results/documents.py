"""What the supervisor adds to a record: picture, request, result, report, and last the manifest."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from pincette.api.job_kinds import job_kinds
from pincette.api.live import LoopTiming
from pincette.core.files import make_folder
from pincette.core.messages import Recorded
from pincette.records import folder as files
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.results.drawing import Picture
from pincette_supervisor.results.report import report

SAID = ("sample", "batch", "operator", "notes")
LABEL = "label "
"""Begin of the names of labels in a manifest, and in the metadata of files of samples."""
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
    picture: Picture,
    whose: Mapping[str, str],
    recorded: Recorded | str,
) -> None:
    """Write everything but the samples, which are the recorder's; raises OSError."""
    make_folder(folder)
    kind, state = job_kinds()[planned.plan.kind], completeness(recorded)
    whose = {**whose, **files.times(folder)}
    files.write_bytes(folder / kind.plot, picture.png)
    for end, content in picture.vector.items():
        files.write_bytes((folder / kind.plot).with_suffix(end), content)
    request = {"request": job.request, "values": planned.values, "plan": job.plan}
    files.write_json(folder / files.REQUEST, request)
    files.write_json(folder / files.RESULT, result)
    page = report(
        kind=kind,
        values=planned.values,
        result=result,
        picture=picture.png,
        whose=whose,
        state=state,
        timing=_timing(folder),
    )
    files.write_bytes(folder / files.REPORT, page.encode())
    files.write_manifest(folder, {**whose, **state})
    files.pin(folder, pinned=job.pinned)


def said_of(job: JobRow) -> dict[str, str]:
    """What was said of a job, as its files state it; what is empty is left out."""
    texts = {
        **{name: str(getattr(job, name)) for name in SAID},
        **{f"{LABEL}{name}": text for name, text in job.labels.items()},
    }
    return {name: text for name, text in texts.items() if text}


def restate(folder: Path, job: JobRow) -> None:
    """State in report and manifest what is said of a job by now; raises OSError.

    Files of samples are never written again: they say what was said when they were made.
    """
    kind = job_kinds().get(job.kind)
    manifest = files.read_manifest(folder)
    if not manifest:
        return
    state = {name: manifest.pop(name) for name in ("complete", "detail") if name in manifest}
    manifest.pop("files", None)
    whose: dict[str, str] = said_of(job) | {
        name: value
        for name, value in manifest.items()
        if name not in SAID and not name.startswith(LABEL)
    }
    picture, written = folder / (kind.plot if kind else ""), set[str]()
    if kind is not None and job.result is not None and picture.is_file():
        page = report(
            kind=kind,
            values=job.plan.get("values", {}),
            result=job.result,
            picture=picture.read_bytes(),
            whose=whose,
            state=state,
            timing=_timing(folder),
        )
        files.write_bytes(folder / files.REPORT, page.encode())
        written = {files.REPORT}
    files.write_manifest(folder, {**whose, **state}, written)


def _timing(folder: Path) -> LoopTiming | None:
    """What the recorder has kept of the programs' loop_timing."""
    with suppress(OSError, ValueError):
        return LoopTiming.model_validate_json((folder / files.TIMING).read_bytes())
    return None
