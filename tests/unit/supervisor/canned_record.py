"""The record that a canned rig leaves: a table of its samples, as the recorder makes one."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from pincette.config import RigFile
from pincette.messages import Finish, Message, Record, Recorded
from pincette.records import folder
from pincette.records.columns import columns


class Recording(Protocol):
    """Where records go, and what is wrong with them."""

    rig: RigFile
    records: Path
    incomplete: str


def closed(of: Recording, begun: Record, request: Finish, played: Sequence[Message]) -> Recorded:
    """Close the record as the recorder does: with a table of the samples."""
    assert (begun.job, begun.epoch) == (request.job, request.epoch)
    about = {key: str(value) for key, value in json.loads(begun.about).items()}
    where = of.records / request.job
    where.mkdir(parents=True, exist_ok=True)
    table = columns(played, of.rig.rig.period_s)
    folder.write_samples(where / folder.SAMPLES, table, about)
    return Recorded(request.job, len(played), 0, not of.incomplete, of.incomplete)
