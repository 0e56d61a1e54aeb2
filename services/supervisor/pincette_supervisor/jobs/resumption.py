"""A calibration that a stall of the machine has tripped with the arm free: it begins again.

A person has acknowledged that one trip beforehand, by ``tries`` of the request; every other latch
waits for a person. What presses a part is begun by a person again, who sees where the part is.
"""

from typing import NamedTuple

from pincette.api.requests import JobRequest
from pincette_supervisor.alarms.trips import TripReason
from pincette_supervisor.jobs.stalls import silence_s
from pincette_supervisor.kinds.calibrate.calibration import functions_of
from pincette_supervisor.kinds.calibrate.request import CalibrationRequest
from pincette_supervisor.kinds.functions import Run

BY_HAND = "a person begins it again from its start, since it presses a part"
NO_MORE = "it has begun as often as `tries` says"


class Resumption(NamedTuple):
    """What follows a calibration that has tripped by a stall."""

    words: str
    """Where it goes on, or why it does not by itself."""
    request: JobRequest | None
    """Of the job that goes on; None where a person must begin it."""


def resumption(request: JobRequest, run: Run, reason: TripReason) -> Resumption | None:
    """How a job goes on after a trip; None of another kind of job, or of another trip."""
    if not isinstance(request, CalibrationRequest) or silence_s(run.rig, reason) is None:
        return None
    functions = functions_of(request.calibration)
    if functions.meets_part:
        return Resumption(BY_HAND, None)
    if request.tries <= 1:
        return Resumption(NO_MORE, None)
    left: dict[str, object] = {"tries": request.tries - 1, "autostart": True, "queue": False}
    following: JobRequest = request.model_copy(update=left)
    if functions.goes_on is None:
        return Resumption("begins again from its start", following)
    following, words = functions.goes_on(following, run)
    return Resumption(words, following)
