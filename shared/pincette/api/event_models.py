"""What happens to jobs and rigs, as those who listen are told."""

from typing import Any, Literal

from pydantic import BaseModel

from pincette.api.job_models import example

EventKind = Literal["state", "phase", "action", "result", "alarm", "queue", "rig", "model"]
"""What is kept and numbered, so that nobody misses it."""
PassingKind = Literal["progress", "dropped"]
"""What is told to those who listen just then: how far a job is, and what they have missed."""


class Event(BaseModel):
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


class EventList(BaseModel):
    """Numbered events, the oldest first."""

    model_config = example(events=[], newest=318, oldest=1)

    events: list[Event]
    newest: int
    """Number of the newest event of all; 0 where there is none."""
    oldest: int
    """Number of the oldest event that is kept; what lies before it is gone."""
