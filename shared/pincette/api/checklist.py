"""Checklist of the calibrations over REST: their order, what each needs, and what it has found."""

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
    """Task of a person at the rig, before the calibration or when its job requests it."""

    model_config = example(
        code="part_removed", text="remove the part; nothing may touch the arm", when="before"
    )

    code: NeedCode
    text: str
    when: Literal["before", "during"]
    """``during``: the job waits, shows the instruction in ``progress``, and continues by the action
    ``continue``."""


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
    """State of the calibration; optional: this rig works without it; unsupported: the instruments
    of this rig are too slow for it."""
    request: dict[str, Any]
    """Request body for ``POST /api/v1/jobs``."""
    needs: list[BenchNeed]
    reasons: list[StepReason]
    """Reasons why the calibration is due; empty if it is done."""
    proposal: str | None
    """Proposal that still waits for a decision: accept or discard it before the calibration runs
    again."""
    accepted: str | None
    """Accepted calibration that is in use."""
    accepted_at: str | None
    gained: list[ProposedValue]
    """Values that the calibration in use has found, each with the earlier value."""
    statement: str
    """Certainty of those values, in words."""


class Checklist(Model):
    """Calibrations of a rig, in the order in which to run them."""

    model_config = example(rig="demo", next="noise", steps=[])

    rig: str
    next: str | None
    """Calibration to run now, or whose proposal needs a decision; null if none is left."""
    steps: list[ChecklistStep]
