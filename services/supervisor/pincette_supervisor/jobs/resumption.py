"""A calibration that begins again by itself, with the arm free.

One that a stall of the machine has tripped: a person has acknowledged that one trip beforehand, by
``tries`` of the request; every other latch waits for a person. And one that has led the arm beyond
a limit of position, which trips nothing: it moves less. What presses a part is begun by a person
again, who sees where the part is.
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


class NextJob(NamedTuple):
    """The job that goes on."""

    request: JobRequest
    acknowledges: bool
    """Whether it resets the latch of the job before."""


class Resumption(NamedTuple):
    """What follows a calibration that has tripped by a stall, or gone too far."""

    words: str
    """Where it goes on, or why it does not by itself."""
    next_job: NextJob | None
    """None where a person must begin it."""


def resumption(request: JobRequest, run: Run, reason: TripReason) -> Resumption | None:
    """How a job goes on after a trip; None of another kind of job, or of another trip."""
    if not isinstance(request, CalibrationRequest) or silence_s(run.rig, reason) is None:
        return None
    functions = functions_of(request.calibration)
    if functions.meets_part:
        return Resumption(BY_HAND, None)
    following = _following(request)
    if following is None:
        return Resumption(NO_MORE, None)
    if functions.goes_on is None:
        return Resumption("begins again from its start", NextJob(following, acknowledges=True))
    following, words = functions.goes_on(following, run)
    return Resumption(words, NextJob(following, acknowledges=True))


def moving_less(request: JobRequest, run: Run) -> Resumption | None:
    """How a job goes on that has led the arm too far; None where it does not by itself."""
    if not isinstance(request, CalibrationRequest):
        return None
    less, following = functions_of(request.calibration).moves_less, _following(request)
    if less is None or following is None:
        return None
    found = less(following, run)
    if found is None:
        return None
    following, words = found
    return Resumption(words, NextJob(following, acknowledges=False))


def _following(request: CalibrationRequest) -> CalibrationRequest | None:
    """The request with one try fewer; None where it has had them all."""
    if request.tries <= 1:
        return None
    left: dict[str, object] = {"tries": request.tries - 1, "autostart": True, "queue": False}
    return request.model_copy(update=left)
