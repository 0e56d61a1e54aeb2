"""Alarms as REST tells them."""

from typing import Literal

from pydantic import BaseModel

from pincette.api.job_models import example


class Alarm(BaseModel):
    """Something an operator must learn. It is open until it has been acknowledged and is over."""

    model_config = example(
        id=17,
        rig="demo",
        job="20260301-120000-1f0c",
        severity="alarm",
        cause="command_age",
        words="command_age: estimator silent for 62 ms, limit 50 ms",
        clears="reset",
        count=1,
        raised_at="2026-03-01T12:00:09.250Z",
        last_at="2026-03-01T12:00:09.250Z",
        acknowledged_at=None,
        acknowledged_by=None,
        cleared_at=None,
        open=True,
    )

    id: int
    rig: str
    job: str | None
    """The job that had the rig; null without one."""
    severity: Literal["alarm", "warning"]
    """``warning``: nothing has stopped."""
    cause: str
    """A code, which does not change; ``words`` are for people."""
    words: str
    clears: Literal["reset", "condition", "acknowledge"]
    """What ends it: a reset of the rig, the condition itself, or, where it is over at once, the
    acknowledgement."""
    count: int
    """How often it has come while it was open."""
    raised_at: str
    last_at: str
    acknowledged_at: str | None
    acknowledged_by: str | None
    cleared_at: str | None
    """When it was seen to be over."""
    open: bool


class AlarmList(BaseModel):
    """Alarms, the newest first."""

    model_config = example(alarms=[], next=None, open=0)

    alarms: list[Alarm]
    next: int | None
    """For ``before``, to read on; null at the end."""
    open: int
    """How many are open in all, of the rig that was asked for or of every one."""


class AlarmAction(BaseModel):
    """What shall become of an alarm."""

    model_config = example(type="acknowledge")

    type: Literal["acknowledge"]
    """A person has seen it. It moves nothing, and resets nothing."""
