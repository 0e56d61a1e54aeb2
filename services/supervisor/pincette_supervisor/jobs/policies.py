"""Effects of a stop and an abort on a held part, and deadlines of states."""

from collections.abc import Mapping

from pincette.api.endings import EndingCode
from pincette.api.requests import JobRequest, PolicyRequest
from pincette.api.states import STATES, JobState
from pincette.config import RigFile
from pincette.core.faults import ActionCode, Cause, LeaseEnd
from pincette.core.messages import Trip
from pincette_supervisor.planning.planned import Planned

STOPS = {"hold": LeaseEnd.STOP, "release": LeaseEnd.LET_GO, "retract": LeaseEnd.RETRACT}
"""The controller's action for each ``on_stop``."""
CALIBRATE = "calibrate"
UNTOLD: Mapping[JobState, EndingCode] = {
    "succeeded": "done",
    "stopped": "requested",
    "aborted": "requested",
    "interrupted": "supervisor_ended",
}
"""Default code of the ending for each state in which a job ends."""
RELEASING = ("unload", "release", "retreat")
"""Phases that a stop plays if ``on_stop`` releases the part."""


CALIBRATING = 3.0
"""Times ``lease_s`` that a calibration plays on without its supervisor: it lasts for minutes, a
machine that stalls must not end it, and at its end it lets a part go."""


def on_stop(request: JobRequest) -> str:
    """What a stop does: hold, release or retract; a calibration presses to measure, not to hold."""
    if isinstance(request, PolicyRequest):
        return request.on_stop
    return "retract" if request.kind == CALIBRATE else "hold"


def interruption(kind: str) -> ActionCode:
    """How a program is stopped whose supervisor ends, or has ended: a part stays held, but for a
    calibration's."""
    return ActionCode.RETRACT if kind == CALIBRATE else ActionCode.STOP


def lease_s(request: JobRequest, rig: RigFile) -> float:
    """How long a program plays on while nothing is heard of the supervisor; 0: to its end."""
    return rig.safety.lease_s * (CALIBRATING if request.kind == CALIBRATE else 1.0)


def lease_end(request: JobRequest) -> LeaseEnd:
    """How the controller stops, also where the lease has ended."""
    return STOPS[on_stop(request)]


def abort_trip(request: JobRequest, why: str) -> Trip:
    """The trip of an abort, a freeze unless the request says ramp; ``why`` unless a person asks."""
    ramps = isinstance(request, PolicyRequest) and request.on_abort == "ramp"
    return Trip(Cause.SUPERVISOR if why else Cause.ABORT, release_now=ramps, words=why)


def deadline_s(
    state: JobState, planned: Planned | None, rig: RigFile, on_stop: str
) -> float | None:
    """Time in s after which a state has taken too long; None if it may last."""
    row = STATES[state]
    if row.deadline_s is None:
        return None
    if row.beyond == "" or planned is None:
        return row.deadline_s
    if row.beyond == "freeze":
        return row.deadline_s + rig.safety.freeze_s + rig.safety.ramp_s
    if row.beyond == "letting_go":
        return row.deadline_s + (0.0 if on_stop == "hold" else _release_s(planned))
    if state == "running" and planned.planned_s is None:
        return None  # a program without an end, whose pause must come all the same
    return row.deadline_s + planned.plan.duration_s


def _release_s(planned: Planned) -> float:
    return sum(item.duration_s or 0.0 for item in planned.plan.phases if item.phase in RELEASING)
