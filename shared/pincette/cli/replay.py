"""``pincette replay``: a recorded job through its services again, compared bit by bit."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from pincette import __version__, plugins
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, does, machine
from pincette.cli.output import emit, screen
from pincette.cli.rest import CliError
from pincette.cli.tables import table
from pincette.config import ConfigError, RigFile, parse_rig
from pincette.messages import Asked, Message, Sample
from pincette.records.mcap_reading import Recording, read
from pincette.runtime.replay.comparison import Difference, Findings
from pincette.runtime.replay.service_alone import replay as repeat
from pincette.runtime.replay.steps import STEPS

ABOUT = "play a recorded job through its services again; say where one gives anything else"
RECORD, RIG = "job.mcap", "rig.json"


def add(word: Words) -> None:
    """Add ``replay``."""
    one = machine(word("replay", ABOUT))
    one.add_argument(
        "records",
        nargs="+",
        type=Path,
        metavar="RECORD",
        help="folder of a job, or its job.mcap",
    )
    one.add_argument("--service", choices=list(STEPS), help="this one alone; all if not given")
    does(one, replay)


def replay(given: argparse.Namespace) -> int:
    """Repeat records; the exit status is 1 where an output differs, or cannot be repeated."""
    names = [given.service] if given.service else list(STEPS)
    found: dict[str, list[Findings]] = {}
    for path in given.records:
        recording = opened(path)
        rig, messages = rig_of(recording, path), epoch_of(recording)
        services = [plugins.load(plugins.SERVICES, name) for name in names]
        found[str(path)] = [repeat(service, rig, messages) for service in services]
        if not given.json:
            show(path, recording, found[str(path)])
    if given.json:
        emit(
            [
                {"record": path, "services": [asdict(one) for one in services]}
                for path, services in found.items()
            ]
        )
    same = all(one.same for services in found.values() for one in services)
    return Exit.DONE if same else Exit.FAILED


def opened(path: Path) -> Recording:
    """Read a record; raises CliError where it cannot be."""
    file = path / RECORD if path.is_dir() else path
    try:
        return read(file)
    except (OSError, ValueError) as error:
        raise CliError(f"{file} cannot be read: {error}") from error


def rig_of(recording: Recording, path: Path) -> RigFile:
    """The rig file that a record was made with; raises CliError where it holds none."""
    if RIG not in recording.attachments:
        raise CliError(f"{path} holds no {RIG}: what it was made with is not known")
    try:
        return parse_rig(json.loads(recording.attachments[RIG]))
    except (ConfigError, ValueError) as error:
        raise CliError(f"{path}: {RIG} in it: {error}") from error


def epoch_of(recording: Recording) -> list[Message]:
    """Messages of the epoch that was recorded."""
    epoch = recording.about.get("epoch")
    told = [item for item in recording.messages if isinstance(item, Sample | Asked)]
    return [item for item in told if epoch is None or str(item.epoch) == epoch]


def show(path: Path, recording: Recording, found: list[Findings]) -> None:
    """Print a table of services, and why one was not repeated."""
    console = screen()
    console.print(str(path), markup=False, soft_wrap=True)
    rows = table("service", "steps", "identical", "different", "first difference", right=())
    for one in found:
        counts = [str(count) for count in (one.steps, one.identical, one.different)]
        rows.add_row(one.service, *counts, words(one.first))
    console.print(rows)
    for one in found:
        if one.stopped:
            _say(f"{one.service}: not repeated from here on: {one.stopped}")
        if one.clocked:
            _say(f"{one.service}: {one.clocked} outputs by its clock alone, which is not recorded")
    made = recording.about.get("pincette", __version__)
    if made != __version__ and not all(one.same for one in found):
        _say(f"recorded by pincette {made}, repeated by {__version__}")


def words(difference: Difference | None) -> str:
    """Where a service gives anything else."""
    if difference is None:
        return ""
    where = f"{difference.topic} {difference.seq}"
    if not difference.field:
        return f"{where} is not said again"
    return (
        f"{where}, {difference.field}: {difference.recorded!r} recorded, "
        f"{difference.replayed!r} repeated"
    )


def _say(text: str) -> None:
    screen().print(f"  {text}", markup=False, soft_wrap=True)
