"""``pincette records`` and ``replay``: what jobs have recorded; ``topics``: what a rig sends."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from pincette import __version__
from pincette.cli import CliError, Exit, opened
from pincette.cli.access import Target
from pincette.cli.options import Limit
from pincette.cli.output_file import write_output
from pincette.cli.readers import choice
from pincette.cli.results import outcome
from pincette.cli.rigs import timing_table
from pincette.cli.spreadsheet import ForSpreadsheet, for_spreadsheet
from pincette.cli.terminal import (
    Json,
    RigOption,
    clock,
    command,
    emit,
    group,
    patience,
    screen,
    table,
)
from pincette.core import plugins
from pincette.core.files import temporary_folder
from pincette.engine.replay.steps import STEPS

if TYPE_CHECKING:
    from pincette.api.live import LoopTiming
    from pincette.client import JobHandle
    from pincette.config import RigFile
    from pincette.core.messages import Message
    from pincette.engine.replay.comparison import Difference, Findings
    from pincette.records.mcap_reading import Recording


SAMPLES = "samples.csv"
JobName = Annotated[str, Argument(metavar="JOB", help="its id, or `last`")]
Out = Annotated[
    Path | None,
    Option("--out", metavar="FOLDER", help="where to; a folder named as the job if not given"),
]

app = group()
records_app = group("records", "list records of jobs, and download their files")
app.add_typer(records_app)


@command(records_app, "list")
def list_records(target: Target, limit: Limit = 20) -> None:
    """List jobs that have left a record, the newest first."""
    jobs = [one.job for one in target.rig().jobs(limit) if one.job.record]
    complete = {True: "complete", False: "incomplete", None: ""}
    rows = [
        (job.id, job.kind, outcome(job), clock(job.ended_at), complete[job.record_complete])
        for job in jobs
    ]
    shown = table("job", "kind", "outcome", "ended", "record", rows=rows, right=())
    target.answer(jobs, shown, "no job has left a record yet")


@command(records_app, "show")
def show(target: Target, name: JobName) -> None:
    """List the files of a record, and how punctual the loop was."""
    from pincette.records.folder import TIMING

    job = target.job(name)
    files = job.artifacts()
    rows = [(file.name, size(file.bytes), file.sha256[:16]) for file in files]
    target.answer(files, table("file", "size", "SHA-256", rows=rows, right=("size",)))
    if target.json:
        return
    if TIMING in [file.name for file in files]:
        screen().print(timing_table(_timing(job)))
    if job.job.record_detail:
        print(job.job.record_detail)


def _timing(job: "JobHandle") -> "LoopTiming":
    from pincette.api.live import LoopTiming
    from pincette.records.folder import TIMING

    with temporary_folder() as folder:
        return LoopTiming.model_validate_json(job.download(TIMING, folder).read_bytes())


def size(count: int) -> str:
    """A number of bytes with its unit."""
    amount = float(count)
    for unit in ("B", "kB", "MB"):
        if amount < 1000.0:
            return f"{amount:.0f} {unit}" if unit == "B" else f"{amount:.1f} {unit}"
        amount /= 1000.0
    return f"{amount:.2f} GB"


@command(records_app, "get")
def get(
    target: Target,
    name: JobName,
    files: Annotated[
        list[str] | None, Argument(metavar="FILE", help="all of them if not given")
    ] = None,
    out: Out = None,
) -> None:
    """Download files of a record, each checked by its SHA-256."""
    job = target.job(name)
    names = files or [file.name for file in job.artifacts()]
    _download(target, job, names, out)


@command(records_app, "csv")
def csv(target: Target, name: JobName, out: Out = None, spreadsheet: ForSpreadsheet = None) -> None:
    """Download the samples of a record as CSV."""
    for path in _download(target, target.job(name), [SAMPLES], out):
        if spreadsheet is not None:
            write_output(path, for_spreadsheet(path.read_bytes(), spreadsheet))


@command(records_app, "delete")
def delete(target: Target, name: JobName) -> None:
    """Delete the files of a job that has ended and is not pinned; its result stays."""
    job = target.job(name)
    target.answer(job.delete_record(), f"job {job.id}: its record is deleted")


def _download(target: Target, job: "JobHandle", names: list[str], out: Path | None) -> list[Path]:
    with patience(f"downloading {len(names)} files"):
        paths = [job.download(name, out or Path(job.id)) for name in names]
    shown = [str(path) for path in paths]
    target.answer(shown, "\n".join(shown))
    return paths


RECORD, RIG = "job.mcap", "rig.json"


@command(app, "replay")
def replay(
    form: Json,
    records: Annotated[
        list[Path], Argument(metavar="RECORD", help="folder of a job, or its job.mcap")
    ],
    service: Annotated[
        str | None,
        Option(
            "--service",
            parser=choice(list(STEPS)),
            metavar="|".join(STEPS),
            help="only this one; all if not given",
        ),
    ] = None,
) -> int:
    """Repeat records; the exit status is 1 if an output differs, or cannot be repeated."""
    from pincette.engine.replay.service_alone import replay as repeat

    names = [service] if service else list(STEPS)
    found: dict[str, list[Findings]] = {}
    for path in records:
        recording = opened_record(path)
        rig, messages = rig_of(recording, path), epoch_of(recording)
        services = [plugins.load(plugins.SERVICES, name) for name in names]
        found[str(path)] = [repeat(service, rig, messages) for service in services]
        if not form.json:
            show_findings(path, recording, found[str(path)])
    if form.json:
        emit(
            [
                {"record": path, "services": [asdict(one) for one in services]}
                for path, services in found.items()
            ]
        )
    same = all(one.same for services in found.values() for one in services)
    return Exit.DONE if same else Exit.FAILED


def opened_record(path: Path) -> "Recording":
    """Read a record; raises CliError where it cannot be."""
    from pincette.records.mcap_reading import read

    file = path / RECORD if path.is_dir() else path
    try:
        return read(file)
    except (OSError, ValueError) as error:
        raise CliError(f"{file} cannot be read: {error}") from error


def rig_of(recording: "Recording", path: Path) -> "RigFile":
    """The rig file that a record was made with; raises CliError where it holds none."""
    from pincette.config import ConfigError, parse_rig

    if RIG not in recording.attachments:
        raise CliError(f"{path} holds no {RIG}: what it was made with is not known")
    try:
        return parse_rig(json.loads(recording.attachments[RIG]))
    except (ConfigError, ValueError) as error:
        raise CliError(f"{path}: {RIG} in it: {error}") from error


def epoch_of(recording: "Recording") -> "list[Message]":
    """Messages of the epoch that was recorded."""
    from pincette.core.messages import RequestLog, Sample

    epoch = recording.about.get("epoch")
    messages = [item for item in recording.messages if isinstance(item, Sample | RequestLog)]
    return [item for item in messages if epoch is None or str(item.epoch) == epoch]


def show_findings(path: Path, recording: "Recording", found: "list[Findings]") -> None:
    """Print a table of services, and why one was not repeated."""
    console = screen()
    console.print(str(path), markup=False, soft_wrap=True)
    names = ("service", "steps", "identical", "different", "first difference")
    rows = [
        (
            one.service,
            f"{one.steps}",
            f"{one.identical}",
            f"{one.different}",
            _difference(one.first),
        )
        for one in found
    ]
    console.print(table(*names, rows=rows, right=()))
    for one in found:
        if one.stopped:
            _say(f"{one.service}: not repeated from here on: {one.stopped}")
        if one.clocked:
            _say(f"{one.service}: {one.clocked} outputs by its clock alone, which is not recorded")
    made = recording.about.get("pincette", __version__)
    if made != __version__ and not all(one.same for one in found):
        _say(f"recorded by pincette {made}, repeated by {__version__}")


def _difference(difference: "Difference | None") -> str:
    if difference is None:
        return ""
    where = f"{difference.topic} {difference.seq}"
    if not difference.field:
        return f"{where} is not repeated"
    return (
        f"{where}, {difference.field}: {difference.recorded!r} recorded, "
        f"{difference.replayed!r} repeated"
    )


def _say(text: str) -> None:
    screen().print(f"  {text}", markup=False, soft_wrap=True)


@command(app, "topics")
def topics(rig: RigOption, form: Json) -> None:
    """List what is published and what is answered, a key a line."""
    name = opened(rig.path).rig.name
    form.answer(topics_tree(name), lambda: _print_topics(name))


def _print_topics(name: str) -> None:
    from pincette.core.topics import REQUESTS, TOPICS, key, request_key

    print("published, a MessagePack map a sample, units in the field names:")
    _print([(key(name, one), one.message.__name__, one.summary) for one in TOPICS])
    print("\nrequested, with request and reply:")
    types = [f"{one.request.__name__} → {one.reply.__name__}" for one in REQUESTS]
    keys = [request_key(name, one) for one in REQUESTS]
    _print(list(zip(keys, types, strict=True)))


def topics_tree(name: str) -> dict[str, list[dict[str, str]]]:
    """Topics and requests of a rig as plain data."""
    from pincette.core.topics import REQUESTS, TOPICS, key, request_key

    return {
        "published": [
            {
                "key": key(name, topic),
                "message": topic.message.__name__,
                "producer": topic.producer,
                "summary": topic.summary,
            }
            for topic in TOPICS
        ],
        "asked": [
            {
                "key": request_key(name, question),
                "request": question.request.__name__,
                "reply": question.reply.__name__,
                "summary": question.summary,
            }
            for question in REQUESTS
        ],
    }


def _print(rows: list[tuple[str, ...]]) -> None:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        print(f"  {'  '.join(cells)}".rstrip())
