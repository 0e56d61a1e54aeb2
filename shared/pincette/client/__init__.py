"""Run jobs from your own program: ``Supervisor``, and with the same names ``AsyncSupervisor``.

    with Supervisor("http://127.0.0.1:8000") as supervisor:
        job = supervisor.rig().start("grip", force_mN=15.0)
        print(job.wait().state, job.result())

Units are in the names: µm, mN, V, s. What is refused raises ``ProblemError``, whose text says what,
value, unit, limit and what to do; where nobody answers, ``NoAnswerError``.
"""

from pincette.client.async_job_handle import AsyncJobHandle
from pincette.client.async_rig_handle import AsyncRigHandle
from pincette.client.async_supervisor import AsyncSupervisor
from pincette.client.errors import (
    ClientError,
    DamagedFileError,
    ForeignAnswerError,
    NoAnswerError,
    ProblemError,
    WaitTimeoutError,
    WhichRigError,
)
from pincette.client.job_handle import JobHandle
from pincette.client.rig_handle import RigHandle
from pincette.client.supervisor import Supervisor

__all__ = [
    "AsyncJobHandle",
    "AsyncRigHandle",
    "AsyncSupervisor",
    "ClientError",
    "DamagedFileError",
    "ForeignAnswerError",
    "JobHandle",
    "NoAnswerError",
    "ProblemError",
    "RigHandle",
    "Supervisor",
    "WaitTimeoutError",
    "WhichRigError",
]
