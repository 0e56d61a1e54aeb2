"""Requests and plans of all installed kinds as types, for REST and the journal."""

from typing import TYPE_CHECKING, Literal

from pydantic import TypeAdapter

from pincette.api.job_kinds import discriminated, job_kinds, union
from pincette.api.plans import JobPlan
from pincette.api.requests import JobRequest
from pincette_supervisor.kinds.calibrate import KIND as CALIBRATE

_KINDS = list(job_kinds().values())

if TYPE_CHECKING:
    Body = CalibrationBody = TrajectoryBody = JobRequest
    AnyPlan = JobPlan
    KindName = str
else:
    Body = discriminated([kind.body for kind in _KINDS], "kind")
    """Request for a job; its kind is in ``kind``."""
    CalibrationBody = CALIBRATE.body
    """Request for a calibration; its name is in ``calibration``."""
    TrajectoryBody = discriminated([kind.body for kind in _KINDS if kind.predicted], "kind")
    """Request of a kind whose course is predicted."""
    AnyPlan = union(plan for kind in _KINDS for plan in kind.plans)
    KindName = Literal[tuple(kind.name for kind in _KINDS)]

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
