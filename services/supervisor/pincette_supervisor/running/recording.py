"""The recorder as the supervisor sees it: asked to begin before arming, and to finish after.

A recorder that is absent or refuses is told in words; nothing here raises, since a job that has
moved must come to its end whatever becomes of its record.
"""

import json
from collections.abc import Mapping
from typing import cast

from pincette.bus.protocol import Bus, BusError
from pincette.messages import Document, Finish, Record, Recorded
from pincette.topics import FINISH, RECORD
from pincette_supervisor.results.documents import completeness as completeness

BEGIN_S = 5.0
FINISH_S = 10.0
FINISH_PER_SAMPLE_S = 6e-4
"""Making the tables takes longer where there is more to put into them."""
NOTHING = -2
"""Number of the last sample of a loop that has said nothing: arming is -1."""


def begin(bus: Bus, job: str, epoch: int, about: Mapping[str, str]) -> str:
    """Open the record of an epoch that is about to be armed; returns why not, or nothing.

    Asked again while the record is open, it makes the tables of what has come so far and goes on:
    for a job that has ended while its part is still held.
    """
    document = Document(json.dumps(dict(about), ensure_ascii=False))
    try:
        bus.ask(RECORD, Record(job, epoch, document), BEGIN_S)
    except BusError as error:
        return str(error)
    return ""


def finish(bus: Bus, job: str, epoch: int, last_seq: int) -> Recorded | str:
    """Close the record; what it has, or why nobody says so."""
    patience_s = FINISH_S + FINISH_PER_SAMPLE_S * max(0, last_seq)
    try:
        return cast(Recorded, bus.ask(FINISH, Finish(job, epoch, last_seq), patience_s))
    except BusError as error:
        return str(error)
