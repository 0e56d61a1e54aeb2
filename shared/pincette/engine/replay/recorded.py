"""The record of a job in the form for a replay: its rig file and the messages of its epoch."""

import json
from pathlib import Path

from pincette.config import ConfigError, RigFile, parse_rig
from pincette.core.messages import Message, RequestLog, Sample
from pincette.records.mcap_reading import Recording, read

RECORD, RIG = "job.mcap", "rig.json"


def read_record(path: Path) -> Recording:
    """Read the record of a job, by its folder or its MCAP file; raises ValueError."""
    file = path / RECORD if path.is_dir() else path
    try:
        return read(file)
    except (OSError, ValueError) as error:
        raise ValueError(f"{file} cannot be read: {error}") from error


def recorded_rig(recording: Recording, path: Path) -> RigFile:
    """Return the rig file of a record; raises ValueError if it has none."""
    if RIG not in recording.attachments:
        raise ValueError(f"{path} holds no {RIG}: the rig file that it was made with is not known")
    try:
        return parse_rig(json.loads(recording.attachments[RIG]))
    except (ConfigError, ValueError) as error:
        raise ValueError(f"{path}: {RIG} in it: {error}") from error


def recorded_epoch(recording: Recording) -> list[Message]:
    """Return the messages of the recorded epoch."""
    epoch = recording.about.get("epoch")
    messages = [item for item in recording.messages if isinstance(item, Sample | RequestLog)]
    return [item for item in messages if epoch is None or str(item.epoch) == epoch]
