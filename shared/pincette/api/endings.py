"""Reason for the end of a job: a code with numbers for programs, and a text for people."""

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from pincette.api import Model, example
from pincette.api.checks import FaultView

EndingCode = Literal[
    "done",
    "requested",
    "bad_outcome",
    "no_finding",
    "unverified",
    "accepted",
    "samples_missing",
    "tripped",
    "silent",
    "overdue",
    "lease_ended",
    "unanswered",
    "refused",
    "not_ready",
    "plan_refused",
    "not_recorded",
    "not_stored",
    "queue_cleared",
    "rejected",
    "proposal_expired",
    "request_outdated",
    "supervisor_ended",
    "internal",
]
ENDINGS: Mapping[EndingCode, str] = {
    "done": "the motion program ran to its end with a good outcome",
    "requested": "a person has stopped or aborted it, or released its part while it was loaded",
    "bad_outcome": (
        "the motion program ended with another outcome than planned; the result states it"
    ),
    "no_finding": (
        "the motion program ran to its end, but the result cannot be computed from the samples"
    ),
    "unverified": "the zero of the force after the release did not verify the force held",
    "accepted": (
        "the grip did not succeed, and a person or the default of its recovery has accepted its "
        "result"
    ),
    "samples_missing": (
        "more samples of a phase are missing than allowed; the motion program did not run "
        "to its end"
    ),
    "tripped": "the actuator has tripped; trip and faults state why",
    "silent": "a program of the loop sent nothing for too long",
    "overdue": "a state took longer than its deadline",
    "lease_ended": "the controller received nothing from the supervisor for longer than the lease",
    "unanswered": "a program of the rig did not answer",
    "refused": "a program of the rig has refused the job",
    "not_ready": "the rig was not ready when its turn came",
    "plan_refused": "it was refused when it was planned again at its turn; problem states why",
    "not_recorded": "no record could be started",
    "not_stored": "the journal could not be used",
    "queue_cleared": "the queue was cleared",
    "rejected": "a person has rejected it before it began",
    "proposal_expired": "nobody has approved it within its time for that",
    "request_outdated": "this version no longer accepts its request",
    "supervisor_ended": "the supervisor ended while it ran",
    "internal": "the supervisor has a fault, see its log",
}


class Ending(Model):
    """Reason for the end of a job in a form for programs; the job's ``cause`` is the text for
    people.
    """

    model_config = example(
        code="tripped",
        trip="command_age",
        faults=[
            {
                "code": "no_command",
                "values": {"silent_s": 0.062, "limit_s": 0.05},
                "text": "no command for 62 ms, limit 50 ms",
            }
        ],
        values={},
        problem="",
        next_job="",
    )

    code: EndingCode
    trip: str = ""
    """Code of the cause of the actuator's trip; empty if it has not tripped."""
    faults: list[FaultView] = Field(default_factory=list["FaultView"])
    """Faults that the actuator has found."""
    values: dict[str, float] = Field(default_factory=dict[str, float])
    """Numbers by name, such as ``spent_s`` and ``limit_s``. Names end with the unit."""
    problem: str = ""
    """Code of the problem document with which a request with this fault would be rejected."""
    next_job: str = ""
    """Identifier of the job that continues or repeats this one; empty if there is none."""
