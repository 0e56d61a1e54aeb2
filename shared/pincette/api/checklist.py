"""The calibrations as a checklist over REST: their order, what each needs, what it has found."""

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
    """What a person does at the bench: before the calibration, or when its job asks for it."""

    model_config = example(
        code="part_removed", text="take the part away; nothing may touch the arm", when="before"
    )

    code: NeedCode
    text: str
    when: Literal["before", "during"]
    """during: the job waits, says what to do in ``progress``, and goes on by ``continue``."""


class StepReason(Model):
    """Why a calibration is not done, or is to be made again."""

    model_config = example(code="not_calibrated", text="not calibrated yet")

    code: ReasonCode
    text: str


class ChecklistStep(Model):
    """One calibration of the checklist."""

    model_config = example(
        calibration="noise",
        label="noise of the sensor",
        summary="Noise, resolution and drift of the sensor, the arm at rest.",
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
    """optional: this rig works without it; unsupported: its instruments are too slow for it."""
    request: dict[str, Any]
    """Body for ``POST /api/v1/jobs``, as it is."""
    needs: list[BenchNeed]
    reasons: list[StepReason]
    """Empty where it is done."""
    proposal: str | None
    """What it has proposed since; accept or discard it before it is made again."""
    accepted: str | None
    """The calibration that is in use."""
    accepted_at: str | None
    gained: list[ProposedValue]
    """Values in use beside those before; of the calibration that is in use."""
    statement: str
    """How sure those values are, in words."""


class Checklist(Model):
    """The calibrations of a rig in the order to make them."""

    model_config = example(rig="demo", next="noise", steps=[])

    rig: str
    next: str | None
    """The calibration to make now, or whose proposal to decide about; null: none is left."""
    steps: list[ChecklistStep]
