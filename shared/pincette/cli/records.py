"""``pincette records``: downloads, deletes and replays the records of jobs."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from pincette import __version__
from pincette.cli import CliError, Exit
from pincette.cli.access import Target
from pincette.cli.found import JobName
from pincette.cli.output_file import (
    NOT_BOTH,
    ForSpreadsheet,
    NumbersAlone,
    for_spreadsheet,
    write_output,
)
from pincette.cli.readers import choice
from pincette.cli.terminal import Json, command, emit, group, patience, screen, table
from pincette.core import plugins
from pincette.core.validation_wording import value_text
from pincette.engine.replay.steps import STEPS

if TYPE_CHECKING:
    from pincette.engine.replay.comparison import Difference, Findings
    from pincette.records.mcap_reading import Recording


SAMPLES, SNAPSHOT = "samples.csv", "snapshot.mcap"
NUMBERS = ("numbers.csv", "numbers.csv-metadata.json")
Out = Annotated[
    Path | None,
    Option("--out", metavar="FOLDER", help="target folder; named after the job if not given"),
]

app = group()
records_app = group("records", "download files of jobs, delete them, or replay a job")
app.add_typer(records_app)


@command(records_app, "get")
def get(
    target: Target,
    name: JobName,
    files: Annotated[
        list[str] | None,
        Argument(
            metavar="FILE",
            help=f"all if not given; {SAMPLES} and {SNAPSHOT} are made only if named",
        ),
    ] = None,
    out: Out = None,
    spreadsheet: ForSpreadsheet = None,
    numbers: NumbersAlone = False,
) -> None:
    """Download files of a record, each checked by its SHA-256.

    snapshot.mcap is a readable copy of a record that is still being written, or whose recorder was
    killed.
    --spreadsheet and --numbers download the samples.
    """
    if numbers and spreadsheet is not None:
        raise CliError(NOT_BOTH, Exit.USAGE)
    samples = NUMBERS if numbers else (SAMPLES,) if spreadsheet is not None else ()
    if files and samples:
        raise CliError("--spreadsheet and --numbers name the files themselves", Exit.USAGE)
    job = target.job(name)
    names = [*(samples or files or [file.name for file in job.artifacts()])]
    if not names:
        raise CliError(
            f"job {job.id} has no record: it has not started, or its record was deleted; "
            "`pincette job list` shows other jobs"
        )
    with patience(f"downloading {len(names)} files"):
        paths = [job.download(one, out or Path(job.id)) for one in names]
    if spreadsheet is not None:
        write_output(paths[0], for_spreadsheet(paths[0].read_bytes(), spreadsheet))
    shown = [str(path) for path in paths]
    target.answer(shown, "\n".join(shown))


@command(records_app, "delete")
def delete(target: Target, name: JobName) -> None:
    """Delete the files of a job that has ended and is not pinned; its result is kept."""
    job = target.job(name)
    target.answer(job.delete_record(), f"job {job.id}: its record is deleted")


@command(records_app, "replay")
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
            help="only this service; all if not given",
        ),
    ] = None,
) -> int:
    """Replay recorded jobs through their services; the exit status is 1 if an output differs."""
    from pincette.engine.replay.recorded import read_record, recorded_epoch, recorded_rig
    from pincette.engine.replay.service_alone import replay as repeat

    names = [service] if service else list(STEPS)
    found: dict[str, list[Findings]] = {}
    for path in records:
        try:
            recording = read_record(path)
            rig, messages = recorded_rig(recording, path), recorded_epoch(recording)
        except ValueError as error:
            raise CliError(str(error)) from error
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


def show_findings(path: Path, recording: "Recording", found: "list[Findings]") -> None:
    """Print a table of services; for a service that was not replayed, print the reason."""
    console = screen()
    console.print(str(path), markup=False)
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
            _say(f"{one.service}: replay stopped here: {one.stopped}")
        if one.clocked:
            _say(
                f"{one.service}: {one.clocked} outputs that depend on its own clock, which "
                "is not recorded"
            )
    made = recording.about.get("pincette", __version__)
    if made != __version__ and not all(one.same for one in found):
        _say(f"recorded by pincette {made}, replayed by {__version__}")


def _difference(difference: "Difference | None") -> str:
    if difference is None:
        return ""
    where = f"{difference.topic} {difference.seq}"
    if not difference.field:
        return f"{where} is not repeated"
    return (
        f"{where}, {difference.field}: {value_text(difference.recorded)} recorded, "
        f"{value_text(difference.replayed)} replayed"
    )


def _say(text: str) -> None:
    screen().print(f"  {text}", markup=False)
