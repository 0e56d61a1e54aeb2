"""Checklist of the calibrations over REST: their order, requirements and results."""

from typing import Any, Literal

from pincette.api import Model, example
from pincette.api.calibrations import ProposedValue

StepState = Literal["done", "next", "later", "optional", "unsupported"]
NeedCode = Literal["part_removed", "part_in_place", "weights"]
ReasonCode = Literal[
    "not_calibrated",
    "proposed",
    "overdue",
    "instrument_changed",
    "assumption_changed",
    "rig_file_changed",
    "unsupported",
    "refused",
]


class BenchNeed(Model):
    """Task that a person must do at the rig, before the calibration or when its job requests it."""

    model_config = example(
        code="part_removed", text="remove the part; nothing may touch the arm", when="before"
    )

    code: NeedCode
    text: str
    when: Literal["before", "during"]
    """Time of the task. ``during``: the job waits, shows the instruction in ``progress``, and
    resumes after the action ``continue``.
    """


class StepReason(Model):
    """Reason why a calibration is due, or due again."""

    model_config = example(code="not_calibrated", text="not calibrated yet")

    code: ReasonCode
    text: str


class ChecklistStep(Model):
    """One calibration of the checklist."""

    model_config = example(
        calibration="noise",
        label="noise of the sensor",
        summary="Measure noise, resolution and drift of the sensor with the arm at rest.",
        state="next",
        request={"kind": "calibrate", "calibration": "noise", "rig": "demo", "autostart": True},
        needs=[],
        reasons=[{"code": "not_calibrated", "text": "not calibrated yet"}],
        proposal=None,
        accepted=None,
        accepted_at=None,
        gained=[],
        statement="",
    )

    calibration: str
    label: str
    summary: str
    state: StepState
    """State of the calibration. ``optional``: this rig works without it. ``unsupported``: the
    instruments of this rig are too slow for it.
    """
    request: dict[str, Any]
    """Request body for ``POST /api/v1/jobs``."""
    needs: list[BenchNeed]
    reasons: list[StepReason]
    """Reasons why the calibration is due; empty if it is done."""
    proposal: str | None
    """Proposal that still needs a decision; accept or discard it before you repeat the calibration.
    """
    accepted: str | None
    """Accepted calibration that is in use."""
    accepted_at: str | None
    gained: list[ProposedValue]
    """Values found by the calibration in use, each with the value before it."""
    statement: str
    """Certainty of the values in ``gained``, as text."""


class Checklist(Model):
    """Calibrations of a rig, in the order in which to run them."""

    model_config = example(rig="demo", next="noise", steps=[])

    rig: str
    next: str | None
    """Calibration to run now, or to decide about if its proposal is waiting; null if none is
    left.
    """
    steps: list[ChecklistStep]
