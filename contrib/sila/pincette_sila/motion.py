"""Motion from its request to its end, as an observable command of SiLA."""

from collections.abc import AsyncGenerator
from datetime import timedelta
from typing import Any, NamedTuple
from uuid import UUID

from sila2.server import ObservableCommandInstanceWithIntermediateResponses

from pincette.api.jobs import Progress
from pincette.client import AsyncJobHandle, AsyncRigHandle, left_s

LABEL = "sila"
"""Label of a job with the command and the execution UUID that started it."""
UNKNOWN = -1.0
"""Value that replaces an unknown number, since SiLA has no null."""
DEFAULT = -1.0
"""Value of a parameter that is left to the recipe or the rig file; 0 is sent unchanged."""


class Sample(NamedTuple):
    """Sample of a motion; the fields are those of the feature definition."""

    Phase: str
    Position: float
    Force: float
    ForceUncertainty: float
    Voltage: float
    Held: bool


Execution = ObservableCommandInstanceWithIntermediateResponses[Sample]
"""Object that receives a command's progress."""


def given(**fields: Any) -> dict[str, Any]:
    """Return the fields that a caller states; -1 and an empty text mean the default."""
    return {name: value for name, value in fields.items() if value not in (DEFAULT, "")}


def grip_fields(force_mN: float, hold_s: float, recipe: str) -> dict[str, Any]:
    """Return the fields of a grip; a hold time of 0 holds the part until its release."""
    hold: dict[str, Any] = {"until_released": True} if hold_s == 0.0 else {"hold_s": hold_s}
    return {**given(force_mN=force_mN, recipe=recipe), **hold}


def known(value: float | None) -> float:
    """Return a number as SiLA sends it; unknown numbers are replaced."""
    return UNKNOWN if value is None else value


def labels(command: str, execution: UUID) -> dict[str, str]:
    """Return the label of a command's job."""
    return {LABEL: f"{command} {execution}"}


async def start(
    rig: AsyncRigHandle, command: str, execution: UUID, kind: str, **fields: Any
) -> AsyncJobHandle:
    """Start the job of a command, once only."""
    key, named = str(execution), labels(command, execution)
    return await rig.start(kind, idempotency_key=key, labels=named, **fields)


async def reach(
    rig: AsyncRigHandle, execution: UUID, force_mN: float, hold_s: float | None, **fields: Any
) -> tuple[AsyncJobHandle, Progress | None]:
    """Start the job that brings the part to a force, once per command.

    See ``AsyncRigHandle.reach``.
    """
    key, named = str(execution), labels("Grip", execution)
    return await rig.reach(
        force_mN, own=(LABEL, None), hold_s=hold_s, idempotency_key=key, labels=named, **fields
    )


async def follow(moments: AsyncGenerator[Progress], execution: Execution) -> Progress | None:
    """Report the progress of a motion; return the last one.

    Raises the errors of the client's job.
    """
    now: Progress | None = None
    async for now in moments:
        _report(execution, now)
    return now


def _report(execution: Execution, now: Progress) -> None:
    """Report progress, remaining time, and the sample if it is complete."""
    remaining_s = left_s(now)
    if remaining_s is not None:
        whole_s = now.elapsed_s + remaining_s
        share = now.elapsed_s / whole_s if whole_s > 0.0 else 0.0
        execution.progress = max(execution.progress or 0.0, min(1.0, share))
        execution.estimated_remaining_time = timedelta(seconds=remaining_s)
    if now.x_um is not None and now.force_mN is not None and now.voltage_V is not None:
        row = (now.x_um, now.force_mN, known(now.force_uncertainty_mN), now.voltage_V, now.held)
        execution.send_intermediate_response(Sample(now.phase, *row))
