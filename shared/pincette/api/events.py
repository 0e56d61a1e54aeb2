"""Events and alarms of jobs and rigs."""

from typing import Any, Literal

from pincette.api import Model, example

EventKind = Literal[
    "state",
    "phase",
    "action",
    "result",
    "record",
    "alarm",
    "queue",
    "rig",
    "model",
    "edit",
    "claim",
    "series",
]
"""Kinds of event that are stored and numbered, so that no client misses one."""
PassingKind = Literal["progress", "dropped"]
"""Kinds of event that are sent to connected listeners only: progress, and counts of missed
events.
"""


class Event(Model):
    """Event of a job or a rig. When it is sent as a server-sent event, its ``id`` is ``number``."""

    model_config = example(
        number=318,
        at="2026-03-01T12:00:09.250Z",
        rig="demo",
        job="20260301-120000-1f0c",
        kind="state",
        body={"state": "running", "event": "start", "cause": ""},
    )

    number: int | None
    """Number of the event, ascending over all rigs; null if the event is not stored."""
    at: str
    rig: str
    job: str | None
    """Identifier of the job; null if the event concerns only the rig."""
    kind: EventKind | PassingKind
    body: dict[str, Any]
    """Content of the event, by its kind. For ``dropped``: ``progress`` is the number of progress
    events that a slow listener has missed, and ``numbered`` the largest possible number of stored
    events that were deleted before this listener received them.
    """


class EventList(Model):
    """Numbered events, oldest first."""

    model_config = example(events=[], newest=318, oldest=1)

    events: list[Event]
    newest: int
    """Number of the newest event; 0 if there is none."""
    oldest: int
    """Number of the oldest event that is still stored."""


class Alarm(Model):
    """Alarm for the operator.

    The alarm stays open until its condition has ended and a person has acknowledged it.
    """

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
    """Job that used the rig; null if there was none."""
    severity: Literal["alarm", "warning"]
    """Severity of the alarm. For a ``warning``, nothing was stopped."""
    cause: str
    """Stable code of the cause; ``words`` is the text for people."""
    words: str
    clears: Literal["reset", "condition", "acknowledge"]
    """Event that ends the alarm's condition: a reset of the rig, the end of the condition, or, for
    a momentary condition, the acknowledgement.
    """
    count: int
    """Number of times that the condition occurred while the alarm was open."""
    raised_at: str
    last_at: str
    acknowledged_at: str | None
    acknowledged_by: str | None
    cleared_at: str | None
    """Time at which the condition was found to have ended."""
    open: bool


class AlarmList(Model):
    """Alarms, newest first."""

    model_config = example(alarms=[], next=None, open=0)

    alarms: list[Alarm]
    next: int | None
    """Value of ``before`` for the next page; null at the end."""
    open: int
    """Number of open alarms, of the requested rig or of all rigs."""


class AlarmAction(Model):
    """Action on an alarm."""

    model_config = example(type="acknowledge")

    type: Literal["acknowledge"]
    """``acknowledge``: a person has seen the alarm. Nothing moves and nothing is reset."""
