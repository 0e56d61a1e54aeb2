"""Recovery of a job whose grip did not succeed: members of its request, and the decision for which
it waits.
"""

from collections.abc import Mapping
from typing import Annotated, Literal, get_args

from pydantic import Field

from pincette.api import WHOLE, Model, example

RecoveryCase = Literal["no_contact", "wrong_stiffness", "lost", "slipped", "unverified"]
Decision = Literal["retry", "retry_at", "accept", "give_up"]

CASES: Mapping[RecoveryCase, str] = {
    "no_contact": "no part was touched where the plan expects one",
    "wrong_stiffness": "what was touched is harder or softer than the part of the plan",
    "lost": "the part was lost while it was held",
    "slipped": "the part gave way while it was loaded or moved",
    "unverified": "the zero of the force after the release does not verify the force held",
}
"""Cases in which a job can wait for a decision: the outcomes of its program, and a failed check."""
DECISIONS: Mapping[Decision, str] = {
    "retry": "a new job repeats the request",
    "retry_at": "a new job repeats the request at the place that the action states",
    "accept": "the job has succeeded with the result that it has",
    "give_up": "the job has failed",
}


class Recovery(Model):
    """Member ``recovery`` of a request: wait for a decision if the grip does not succeed.

    While the job waits, its motion program has ended, the part is unloaded, and the arm is free and
    at rest.
    """

    model_config = example(wait_s=60.0, default="give_up")

    wait_s: Annotated[float, Field(gt=0, le=86_400)] = 60.0
    """Time limit for the decision, in s."""
    default: Literal["retry", "accept", "give_up"] = "give_up"
    """Decision taken when the time limit expires. ``give_up`` is taken instead if this decision is
    not allowed at that time."""
    tries: Annotated[int, Field(ge=0, le=10), WHOLE] = 1
    """Number of times that the default ``retry`` repeats the job before the job fails."""


class RecoveryWait(Model):
    """Decision for which a job waits."""

    model_config = example(
        case="no_contact",
        decisions=["retry", "retry_at", "give_up"],
        default="give_up",
        until="2026-03-01T12:01:12.400Z",
    )

    case: RecoveryCase
    """Reason why the job waits."""
    decisions: list[Decision]
    """Actions that the job accepts as a decision."""
    default: Decision
    """Decision taken when the time limit expires: the requested one, or ``give_up`` if that is not
    allowed.
    """
    until: str
    """Time, in UTC, at which the default is applied."""


def decisions_of(*, placed: bool, was_held: bool) -> list[Decision]:
    """Return the decisions that a job offers.

    Parameters
    ----------
    placed
        True if the job's request may state the place of the part, which ``retry_at`` requires.
    was_held
        True if a part was held with the requested force, so that there is a result to ``accept``.
    """
    lacking = {"retry_at": not placed, "accept": not was_held}
    return [one for one in get_args(Decision) if not lacking.get(one, False)]
