"""Run jobs from your own program: ``Supervisor``, or ``AsyncSupervisor`` with the same methods.

    with Supervisor("http://127.0.0.1:8000") as supervisor:
        job = supervisor.rig().start("grip", force_mN=15.0)
        print(job.wait().state, job.result())

Units are in the names: µm, mN, V, s. A refusal raises ``ProblemError`` or one of its subclasses, by
the problem code; its text names the value, its unit, the limit and the remedy. ``NoAnswerError``
means that no reply has arrived; its ``delivered`` states whether the request may nevertheless have
been accepted.
"""

from pincette.client.blocking import JobHandle, RigHandle, SeriesHandle, Supervisor
from pincette.client.errors import (
    ClientError,
    DamagedFileError,
    ForceNotReachedError,
    ForeignAnswerError,
    InfeasiblePlanError,
    InvalidRequestError,
    JobEndedError,
    JobWaitsError,
    LimitViolationError,
    NoAnswerError,
    NothingHeldError,
    NotPermittedError,
    PartHeldError,
    ProblemError,
    RequestStoppedError,
    RigBusyError,
    RigLatchedEndError,
    RigLatchedError,
    RigNotReadyError,
    WaitTimeoutError,
    WhichRigError,
)
from pincette.client.following import kept_at_rest, left_s, require_feasible
from pincette.client.job import AsyncJobHandle
from pincette.client.live import LiveSample
from pincette.client.rig import AsyncRigHandle
from pincette.client.series import AsyncSeriesHandle
from pincette.client.status import RigStatus, RigWatch
from pincette.client.supervisor import AsyncSupervisor

__all__ = [
    "AsyncJobHandle",
    "AsyncRigHandle",
    "AsyncSeriesHandle",
    "AsyncSupervisor",
    "ClientError",
    "DamagedFileError",
    "ForceNotReachedError",
    "ForeignAnswerError",
    "InfeasiblePlanError",
    "InvalidRequestError",
    "JobEndedError",
    "JobHandle",
    "JobWaitsError",
    "LimitViolationError",
    "LiveSample",
    "NoAnswerError",
    "NotPermittedError",
    "NothingHeldError",
    "PartHeldError",
    "ProblemError",
    "RequestStoppedError",
    "RigBusyError",
    "RigHandle",
    "RigLatchedEndError",
    "RigLatchedError",
    "RigNotReadyError",
    "RigStatus",
    "RigWatch",
    "SeriesHandle",
    "Supervisor",
    "WaitTimeoutError",
    "WhichRigError",
    "kept_at_rest",
    "left_s",
    "require_feasible",
]
