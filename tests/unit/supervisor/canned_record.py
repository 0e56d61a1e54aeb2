"""The record that a canned rig leaves: a table of its samples, as the recorder makes one."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from pincette.config import RigFile
from pincette.core.faults import Cause, Fault, FaultCode, fault
from pincette.core.messages import Finish, Message, Record, Recorded
from pincette.records import folder
from pincette.records.columns import columns


class Recording(Protocol):
    """Folder of the records, and their faults."""

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


def trip_reason(told: str) -> tuple[Cause, tuple[Fault, ...]]:
    """A trip as a test names it: ``device: no answer``, or ``command_age`` after 51 ms of 50 ms."""
    word, _, words = told.partition(": ")
    if not told:
        return Cause.NONE, ()
    cause = Cause(word) if word in set(Cause) else Cause.ASKED
    if cause == Cause.COMMAND_AGE and words:
        return cause, (fault(FaultCode.NO_COMMAND, silent_s=0.051, limit_s=0.05),)
    code = FaultCode.INSTRUMENT_SILENT if cause == Cause.DEVICE else FaultCode.REQUESTED
    return cause, (fault(code, words),) if words else ()
