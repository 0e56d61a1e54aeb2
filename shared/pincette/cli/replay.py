"""``pincette replay``: a recorded job through one service alone, compared bit by bit."""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, cast

from pincette import plugins
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, does, machine
from pincette.cli.output import emit
from pincette.cli.rest import CliError
from pincette.config import Calibration, ConfigError, parse_rig
from pincette.messages import Arm, Document, Message, Sample
from pincette.records.mcap_reading import Recording, read
from pincette.runtime.node import Node

REMEMBERS = (
    "  the service remembers what came before: name the records since it was started, oldest first"
)
ABOUT = "play a recorded job through one service, and say where it gives anything else"
SERVICES = ("estimator",)
"""Those that need no more than a record holds."""
RECORD, RIG, MODEL = "job.mcap", "rig.json", "model.json"


def add(word: Words) -> None:
    """Add ``replay``."""
    one = machine(word("replay", ABOUT))
    one.add_argument(
        "records",
        nargs="+",
        type=Path,
        metavar="RECORD",
        help="folder of a job, or its job.mcap; several in the order in which they were played",
    )
    one.add_argument("--service", choices=SERVICES, default="estimator", help="%(default)s")
    does(one, replay)


def replay(given: argparse.Namespace) -> int:
    """Compare records one after the other; the exit status is 1 where a sample differs."""
    found: list[dict[str, Any]] = []
    node: Node | None = None
    for path in given.records:
        recording = opened(path)
        node = node or started(recording, given.service)
        compared, differences = compare(node, recording)
        found.append({"record": str(path), "samples": compared, "differences": differences})
        if not given.json:
            print(f"{path}: {given.service}, {told(compared, differences)}")
    if given.json:
        emit(found)
    return Exit.FAILED if any(one["differences"] for one in found) else Exit.DONE


def told(compared: int, differences: list[dict[str, Any]]) -> str:
    """What a comparison says, with the first sample that differs."""
    if not differences:
        return f"{compared} samples, the same to the last bit"
    first = differences[0]
    lines = [f"{len(differences)} of {compared} samples differ; the first is {first['seq']}:"]
    lines += [
        f"  {name}: {recorded!r} recorded, {repeated!r} repeated"
        for name, (recorded, repeated) in first["fields"].items()
    ]
    if first["seq"] == 0:
        lines.append(REMEMBERS)
    return "\n".join(lines)


def opened(path: Path) -> Recording:
    """Read a record; raises CliError where it cannot be, or holds too little."""
    file = path / RECORD if path.is_dir() else path
    try:
        recording = read(file)
    except (OSError, ValueError) as error:
        raise CliError(f"{file} cannot be read: {error}") from error
    if RIG not in recording.attachments:
        raise CliError(f"{file} holds no {RIG}: what it was made with is not known")
    return recording


def started(recording: Recording, name: str) -> Node:
    """A service with the rig file of a record; samples are joined by number, as in lockstep."""
    try:
        rig = parse_rig(json.loads(recording.attachments[RIG]))
    except (ConfigError, ValueError) as error:
        raise CliError(f"{RIG} of the record: {error}") from error
    paced = rig.rig.model_copy(update={"time": "lockstep"})
    return Node(plugins.load(plugins.SERVICES, name), rig.model_copy(update={"rig": paced}))


def compare(node: Node, recording: Recording) -> tuple[int, list[dict[str, Any]]]:
    """Play a record; the number of samples compared, and each that differs."""
    epoch, calibration = int(recording.about["epoch"]), Document(_calibration(recording))
    reply, _ = node.ask(Arm(epoch, 1, node.digest, calibration), 0.0)
    if isinstance(reply, str):
        raise CliError(f"the {node.service.name} refuses the record: {reply}")
    outputs = {topic.message for topic in node.service.outputs}
    said = [cast(Sample, item) for item in recording.messages if type(item) in outputs]
    recorded = {(type(sample), sample.seq): sample for sample in said}
    differences: list[dict[str, Any]] = []
    compared = 0
    for repeated in _played(node, recording.messages):
        expected = recorded.get((type(repeated), repeated.seq))
        if expected is None:
            continue
        compared += 1
        if expected != repeated:
            differences.append({"seq": repeated.seq, "fields": _apart(expected, repeated)})
    if not compared:
        raise CliError(f"the record holds nothing that the {node.service.name} has said")
    return compared, differences


def _calibration(recording: Recording) -> str:
    stored = recording.attachments.get(MODEL)
    if stored is None:
        return ""
    model = json.loads(stored)
    return Calibration(values=model["values"], sources=model["sources"]).text()


def _played(node: Node, messages: Sequence[Message]) -> Iterator[Sample]:
    inputs = {item.topic.message for item in node.service.inputs}
    for message in messages:
        if type(message) not in inputs:
            continue
        node.accept(message, 0.0)
        while node.due(0.0):
            yield from cast("tuple[Sample, ...]", node.fire(0.0))


def _apart(one: Message, other: Message) -> dict[str, tuple[Any, Any]]:
    names = [field.name for field in fields(one)]
    pairs = {name: (getattr(one, name), getattr(other, name)) for name in names}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}
