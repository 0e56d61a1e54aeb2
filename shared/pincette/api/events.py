"""Events and alarms of jobs and rigs."""

from typing import Any, Literal

from pincette.api import Model, example

EventKind = Literal[
    "state", "phase", "action", "result", "alarm", "queue", "rig", "model", "edit", "claim"
]
"""What is kept and numbered, so that nobody misses it."""
PassingKind = Literal["progress", "dropped"]
"""What is told to those who listen just then: how far a job is, and what they have missed."""


class Event(Model):
    """Something that happened; as a server-sent event its ``id`` is the number."""

    model_config = example(
        number=318,
        at="2026-03-01T12:00:09.250Z",
        rig="demo",
        job="20260301-120000-1f0c",
        kind="state",
        body={"state": "running", "event": "start", "cause": ""},
    )

    number: int | None
    """Rises with every event of every rig; null of what is told in passing."""
    at: str
    rig: str
    job: str | None
    """Null of what concerns the rig alone."""
    kind: EventKind | PassingKind
    body: dict[str, Any]
    """What the kind has to say. Of ``dropped``: ``progress``, how many progress events a slow
    listener has missed; ``numbered``, how many numbered ones are kept no more, at most."""


class EventList(Model):
    """Numbered events, the oldest first."""

    model_config = example(events=[], newest=318, oldest=1)

    events: list[Event]
    newest: int
    """Number of the newest event of all; 0 where there is none."""
    oldest: int
    """Number of the oldest event that is kept; what lies before it is gone."""


class Alarm(Model):
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


class AlarmList(Model):
    """Alarms, the newest first."""

    model_config = example(alarms=[], next=None, open=0)

    alarms: list[Alarm]
    next: int | None
    """For ``before``, to read on; null at the end."""
    open: int
    """How many are open in all, of the rig that was asked for or of every one."""


class AlarmAction(Model):
    """What shall become of an alarm."""

    model_config = example(type="acknowledge")

    type: Literal["acknowledge"]
    """A person has seen it. It moves nothing, and resets nothing."""
