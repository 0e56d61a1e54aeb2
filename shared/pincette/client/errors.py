"""Errors of requests to a supervisor, with texts that state what to do."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

import httpx

from pincette.api.jobs import Job
from pincette.api.predictions import Violation
from pincette.api.problems import TYPE


class ClientError(Exception):
    """Base class of the client's errors, which the caller must handle; the text states the
    remedy.
    """

    code = "client-error"
    """Stable code of the error for programs; for a refusal, the code of its problem document."""

    @property
    def cancelled(self) -> bool:
        """True if a motion did not reach its end because a caller stopped it."""
        return False

    @property
    def codes(self) -> dict[str, Any]:
        """Code and numbers of the error as JSON values, for programs that forward the error."""
        return {"code": self.code}


class NoAnswerError(ClientError):
    """Error if there was no reply, or the connection was lost before the reply was complete."""

    code = "no-answer"

    def __init__(self, words: str, *, delivered: bool = False, silent: bool = False) -> None:
        super().__init__(words)
        self.silent = silent
        """True if a connection was established, but no reply arrived in time."""
        self.delivered = delivered
        """True if the request may have been accepted although no reply has arrived."""


class GatewayError(httpx.TransportError):
    """Error if a program between client and supervisor has replied instead of the supervisor."""


class WhichRigError(ClientError):
    """Error if the request does not name a rig and the supervisor serves several."""

    code = "which-rig"


class ForeignAnswerError(ClientError):
    """Error if the reply is not that of a supervisor of this version."""

    code = "foreign-answer"


class WaitTimeoutError(ClientError, TimeoutError):
    """Error if the job has not ended within the time limit; the job continues."""

    code = "wait-timeout"


class InfeasiblePlanError(ClientError):
    """Error if a plan violates limits; no motion was requested."""

    code = "limit-violation"

    def __init__(self, violations: Sequence[Violation]) -> None:
        words = [f"  {one.message}" for one in violations]
        super().__init__("\n".join(["the plan breaks a limit:", *words]))
        self.violations = violations
        """Limits that the plan violates, with pointer, quantity, value and limit."""

    @property
    def codes(self) -> dict[str, Any]:
        """Code of the error, and quantity, value and limit of each violation."""
        violations = [one.model_dump(mode="json") for one in self.violations]
        return {"code": self.code, "violations": violations}


class JobEndedError(ClientError):
    """Error if a job has ended before it reached the state for which the caller waits."""

    code = "job-failed"

    def __init__(
        self,
        words: str,
        job: Job,
        *,
        force_mN: float | None = None,
        asked_mN: float | None = None,
    ) -> None:
        super().__init__(words)
        self.job = job
        self.force_mN = force_mN
        """Force with which the part is now held, in mN; None if no part is held, or it is
        unknown.
        """
        self.asked_mN = asked_mN
        """Force that the job requested, in mN; None if it requested none."""
        if self.cancelled:
            self.code = "cancelled"

    @property
    def cancelled(self) -> bool:
        """True if a caller stopped the job; False if a fault, a lease or a guard did."""
        ending = self.job.ending
        return self.stopped and (ending is None or ending.code == "requested")

    @property
    def stopped(self) -> bool:
        """True if the job ended in the state ``stopped``."""
        return self.job.state == "stopped"

    @property
    def outcome(self) -> str:
        """Outcome code of the job's result, such as ``slipped``; empty without a result."""
        return str((self.job.result or {}).get("outcome", ""))

    @property
    def codes(self) -> dict[str, Any]:
        """Code of the error, outcome of the job, and reason for its end with trip, faults and
        numbers.
        """
        ending = self.job.ending
        return {
            "code": self.code,
            "job": self.job.id,
            "state": self.job.state,
            "outcome": self.outcome,
            "ending": None if ending is None else ending.model_dump(mode="json"),
            "force_mN": self.force_mN,
            "asked_mN": self.asked_mN,
        }


class JobWaitsError(JobEndedError):
    """Error if the motion has ended and the job waits for a decision; see ``job.recovery``."""

    code = "awaiting-recovery"


class ForceNotReachedError(JobEndedError):
    """Error if the force held differs from the requested force by more than the tolerance."""

    code = "force-not-reached"


class RigLatchedEndError(JobEndedError):
    """Error if the job has ended because the rig was latched, for example by an emergency stop."""

    code = "rig-latched"

    @property
    def cancelled(self) -> bool:
        """Always False: a person must inspect the rig."""
        return False


class DamagedFileError(ClientError):
    """Error if the SHA-256 of a record's file differs from the one that the supervisor states."""

    code = "damaged-file"


class ProblemError(ClientError):
    """Error if the supervisor has refused the request with a problem document (RFC 9457)."""

    def __init__(self, status: int, problem: Mapping[str, Any], place: str = "") -> None:
        self.status = status
        self.problem = dict(problem)
        self.code = str(problem.get("type", "")).removeprefix(TYPE)
        """Code of the problem, such as limit-violation or job-active; empty if it has none."""
        self.title = str(problem.get("title", f"status {status}"))
        self.detail = str(problem.get("detail", ""))
        self.place = place
        super().__init__(self._words())

    @property
    def violations(self) -> Sequence[Mapping[str, Any]]:
        """Limits that the plan violates: pointer, quantity, value, limit, unit, at_s, message."""
        return self._members("violations")

    @property
    def errors(self) -> Sequence[Mapping[str, Any]]:
        """Faults of the request: pointer and message."""
        return self._members("errors")

    @property
    def reasons(self) -> Sequence[str]:
        """Reasons why the rig cannot execute the request, as text."""
        return self._members("reasons")

    @property
    def allowed_actions(self) -> Sequence[str]:
        """Actions that the present state of the job allows."""
        return self._members("allowed_actions")

    @property
    def codes(self) -> dict[str, Any]:
        """Code of the error, and the violations and faults of the request that it lists."""
        return {"code": self.code, "violations": self.violations, "errors": self.errors}

    def _members(self, name: str) -> Any:
        found: Any = self.problem.get(name)
        return cast("list[Any]", found) if isinstance(found, list) else []

    def _words(self) -> str:
        """Return the title, followed by one line for each fault, or by the detail."""
        entries: list[Any] = [*self.violations, *self.errors, *self.reasons]
        faults = [str(_told(entry)) for entry in entries]
        if faults:
            return "\n".join([f"{self.title}:", *(f"  {fault}" for fault in faults)])
        return f"{self.title}: {self.detail}" if self.detail else self.title


class LimitViolationError(ProblemError):
    """Error if the plan violates a limit of the rig; ``violations`` list value, unit and limit."""


class InvalidRequestError(ProblemError):
    """Error if the request is invalid, or names something that does not exist."""


class RigBusyError(ProblemError):
    """Error if another job uses the rig, or too many jobs wait; a later request may succeed."""


class PartHeldError(ProblemError):
    """Error if a part is held: release it, or continue to hold it."""

    @property
    def job(self) -> str | None:
        """Job that holds the part; None if no job known to the supervisor holds it."""
        return self.problem.get("job")

    @property
    def labels(self) -> Mapping[str, str]:
        """Labels of the job that holds the part."""
        found: Any = self.problem.get("labels")
        return cast("dict[str, str]", found) if isinstance(found, dict) else {}

    @property
    def force_mN(self) -> float | None:
        """Force with which the part is held, in mN; None if it is unknown."""
        return self.problem.get("force_mN")

    @property
    def codes(self) -> dict[str, Any]:
        """Code of the error, the job that holds the part, its labels and the force."""
        held = {"job": self.job, "labels": dict(self.labels), "force_mN": self.force_mN}
        return {**super().codes, **held}


class NothingHeldError(ProblemError):
    """Error if no part is held, so that nothing can be held or released."""


class RigLatchedError(ProblemError):
    """Error if the rig is latched: a person must inspect and reset it."""


class RigNotReadyError(ProblemError):
    """Error if the rig cannot move; ``reasons`` state why."""


class NotPermittedError(ProblemError):
    """Error if the key is missing, unknown, or has an insufficient scope."""


class RequestStoppedError(ProblemError):
    """Error if the request was stopped by its Idempotency-Key before it had created a job."""

    @property
    def cancelled(self) -> bool:
        """Always True: nothing has moved."""
        return True


RAISED: Mapping[str, type[ProblemError]] = {
    "limit-violation": LimitViolationError,
    "bad-json": InvalidRequestError,
    "invalid-request": InvalidRequestError,
    "idempotency-key-reused": InvalidRequestError,
    "not-found": InvalidRequestError,
    "calibration-unsupported": InvalidRequestError,
    "impossible-model": InvalidRequestError,
    "no-prediction": InvalidRequestError,
    "trajectory-stale": InvalidRequestError,
    "simulation-impossible": InvalidRequestError,
    "job-active": RigBusyError,
    "queue-full": RigBusyError,
    "proposals-full": RigBusyError,
    "queue-moved": RigBusyError,
    "rig-claimed": RigBusyError,
    "model-changed": RigBusyError,
    "too-many-requests": RigBusyError,
    "busy": RigBusyError,
    "part-held": PartHeldError,
    "nothing-held": NothingHeldError,
    "estop-engaged": RigLatchedError,
    "rig-latched": RigLatchedError,
    "rig-not-ready": RigNotReadyError,
    "no-key": NotPermittedError,
    "scope-too-small": NotPermittedError,
    "key-stopped": RequestStoppedError,
}
"""Exception class for each problem code; all other codes raise ``ProblemError`` itself."""


def refused(status: int, code: str, title: str, detail: str, **members: Any) -> ProblemError:
    """Return the error for a request that the client itself refuses; it equals the supervisor's."""
    raised = RAISED.get(code, ProblemError)
    return raised(status, {"type": TYPE + code, "title": title, "detail": detail, **members})


def _told(entry: Any) -> Any:
    """Return the message of a fault, or the whole fault if it has no message."""
    if isinstance(entry, dict):
        fault = cast("dict[str, Any]", entry)
        return fault.get("message", fault)
    return entry


def problem_of(response: httpx.Response) -> ProblemError:
    """Return the error for a reply of the supervisor whose body has been read."""
    place = f"{response.request.method} {response.request.url}"
    try:
        tree: Any = response.json()
    except ValueError:
        tree = None
    if not isinstance(tree, dict) or "title" not in tree:
        words = (
            f"{place}: status {response.status_code}, without a problem document; is it a "
            "supervisor?"
        )
        return ProblemError(response.status_code, {"title": words}, place)
    problem = cast("dict[str, Any]", tree)
    raised = RAISED.get(str(problem.get("type", "")).removeprefix(TYPE), ProblemError)
    return raised(response.status_code, problem, place)
