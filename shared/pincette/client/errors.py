"""Errors between a program and its supervisor, in words that a person can act on."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

import httpx

from pincette.api.jobs import Job
from pincette.api.predictions import Violation
from pincette.api.problems import TYPE


class ClientError(Exception):
    """An error that the caller must handle; its text says what to do."""

    code = "client-error"
    """Stable name of the error for programs; for a refusal that of its problem document."""

    @property
    def cancelled(self) -> bool:
        """Whether a motion did not come to its end because a caller has stopped it."""
        return False

    @property
    def codes(self) -> dict[str, Any]:
        """Codes and numbers of the error as JSON, for programs that pass it on."""
        return {"code": self.code}


class NoAnswerError(ClientError):
    """Nobody answers at the address, or the line broke before the answer was complete."""

    code = "no-answer"

    def __init__(self, words: str, *, delivered: bool = False, silent: bool = False) -> None:
        super().__init__(words)
        self.silent = silent
        """True where a connection was made, but no reply came in time."""
        self.delivered = delivered
        """Whether the request may have been accepted although no answer has come."""


class GatewayError(httpx.TransportError):
    """A program between client and supervisor has answered in its place."""


class WhichRigError(ClientError):
    """The request does not name one of several rigs."""

    code = "which-rig"


class ForeignAnswerError(ClientError):
    """The answer is not that of a supervisor of this version."""

    code = "foreign-answer"


class WaitTimeoutError(ClientError, TimeoutError):
    """The job has not ended within the time that was given; it goes on."""

    code = "wait-timeout"


class InfeasiblePlanError(ClientError):
    """A plan breaks limits; nothing has been asked to move."""

    code = "limit-violation"

    def __init__(self, violations: Sequence[Violation]) -> None:
        words = [f"  {one.message}" for one in violations]
        super().__init__("\n".join(["the plan breaks a limit:", *words]))
        self.violations = violations
        """Limits that the plan breaks, with pointer, quantity, value and limit."""

    @property
    def codes(self) -> dict[str, Any]:
        """Its code, and each violation with quantity, value and limit."""
        violations = [one.model_dump(mode="json") for one in self.violations]
        return {"code": self.code, "violations": violations}


class JobEndedError(ClientError):
    """A job has ended before it reached what the caller waits for."""

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
        """Force with which the part is held now, in mN; None if none is held, or it is unknown."""
        self.asked_mN = asked_mN
        """Force that the job was asked for, in mN; None if it was asked for none."""
        if self.cancelled:
            self.code = "cancelled"

    @property
    def cancelled(self) -> bool:
        """Whether a caller has stopped the job, and no fault, lease or guard has."""
        ending = self.job.ending
        return self.stopped and (ending is None or ending.code == "requested")

    @property
    def stopped(self) -> bool:
        """Whether it was stopped because somebody asked for that."""
        return self.job.state == "stopped"

    @property
    def outcome(self) -> str:
        """Outcome code of the job's result, such as ``slipped``; empty without a result."""
        return str((self.job.result or {}).get("outcome", ""))

    @property
    def codes(self) -> dict[str, Any]:
        """Its code, the job's outcome, and the ending with trip, faults and numbers."""
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


class ForceNotReachedError(JobEndedError):
    """The force held is not the one that was asked for, within its tolerance."""

    code = "force-not-reached"


class RigLatchedEndError(JobEndedError):
    """The job has ended because the rig was latched, for example by an emergency stop."""

    code = "rig-latched"

    @property
    def cancelled(self) -> bool:
        """Never: a person must look at the rig."""
        return False


class DamagedFileError(ClientError):
    """A file of a record does not have the SHA-256 that the supervisor states."""

    code = "damaged-file"


class ProblemError(ClientError):
    """The supervisor has refused: its problem document (RFC 9457)."""

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
        """Limits that the plan breaks: pointer, quantity, value, limit, unit, at_s, message."""
        return self._members("violations")

    @property
    def errors(self) -> Sequence[Mapping[str, Any]]:
        """Faults of the request: pointer and message."""
        return self._members("errors")

    @property
    def reasons(self) -> Sequence[str]:
        """Why the rig cannot, each in words."""
        return self._members("reasons")

    @property
    def allowed_actions(self) -> Sequence[str]:
        """What the state of the job allows instead."""
        return self._members("allowed_actions")

    @property
    def codes(self) -> dict[str, Any]:
        """Its code, and the violations and faults of the request that it states."""
        return {"code": self.code, "violations": self.violations, "errors": self.errors}

    def _members(self, name: str) -> Any:
        found: Any = self.problem.get(name)
        return cast("list[Any]", found) if isinstance(found, list) else []

    def _words(self) -> str:
        """Return its title, then each fault in a line, or its detail."""
        entries: list[Any] = [*self.violations, *self.errors, *self.reasons]
        faults = [str(_told(entry)) for entry in entries]
        if faults:
            return "\n".join([f"{self.title}:", *(f"  {fault}" for fault in faults)])
        return f"{self.title}: {self.detail}" if self.detail else self.title


class LimitViolationError(ProblemError):
    """The plan breaks a limit of the rig; ``violations`` name value, unit and limit."""


class InvalidRequestError(ProblemError):
    """The request cannot be understood, or names what there is not."""


class RigBusyError(ProblemError):
    """Another job has the rig, or too many wait; it may be asked for again later."""


class PartHeldError(ProblemError):
    """A part is held: release it, or go on holding it."""

    @property
    def job(self) -> str | None:
        """Job that holds the part; None if no job of the supervisor does."""
        return self.problem.get("job")

    @property
    def labels(self) -> Mapping[str, str]:
        """Labels of that job."""
        found: Any = self.problem.get("labels")
        return cast("dict[str, str]", found) if isinstance(found, dict) else {}

    @property
    def force_mN(self) -> float | None:
        """Force with which the part is held, in mN; None if it is not known."""
        return self.problem.get("force_mN")

    @property
    def codes(self) -> dict[str, Any]:
        """Its code, with the job that holds the part, the job's labels and the force."""
        held = {"job": self.job, "labels": dict(self.labels), "force_mN": self.force_mN}
        return {**super().codes, **held}


class NothingHeldError(ProblemError):
    """No part is held: there is nothing to hold or to release."""


class RigLatchedError(ProblemError):
    """The rig is latched: a person must look, and reset it."""


class RigNotReadyError(ProblemError):
    """The rig cannot move; ``reasons`` say why."""


class NotPermittedError(ProblemError):
    """The key is missing, unknown, or has too small a scope."""


class RequestStoppedError(ProblemError):
    """The request was stopped by its Idempotency-Key before it had a job."""

    @property
    def cancelled(self) -> bool:
        """Always: nothing has moved."""
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
"""Exception of each problem code; any other problem is a ``ProblemError`` itself."""


def refused(status: int, code: str, title: str, detail: str, **members: Any) -> ProblemError:
    """Return the error of a request that the client itself refuses, as a supervisor would."""
    raised = RAISED.get(code, ProblemError)
    return raised(status, {"type": TYPE + code, "title": title, "detail": detail, **members})


def _told(entry: Any) -> Any:
    """Return the words of a fault, or all of it where it has none."""
    if isinstance(entry, dict):
        fault = cast("dict[str, Any]", entry)
        return fault.get("message", fault)
    return entry


def problem_of(response: httpx.Response) -> ProblemError:
    """Return the error that an answer is; its body must have been read."""
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
