"""What is told of an event of the journal; pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pincette.api.events import Event
from pincette.api.states import STATES
from pincette.config.notify import Told
from pincette_supervisor.journal.tables import JobRow

ALARMS: Mapping[str, Told] = {"raised": "alarm.raised", "cleared": "alarm.cleared"}
SAID = ("kind", "sample", "batch", "operator", "requested_by", "started_at", "ended_at")
"""Members of a job that are told with its end."""


@dataclass(frozen=True, slots=True)
class Notice:
    """One thing that is told."""

    number: int
    """Of its event, which is never given twice: by it a receiver knows what came again."""
    type: Told
    at: str
    title: str
    """One line for people."""
    data: dict[str, Any]

    @property
    def body(self) -> dict[str, Any]:
        """The payload of a webhook."""
        return {"type": self.type, "timestamp": self.at, "data": {"title": self.title, **self.data}}


def topic_of(event: Event) -> Told | None:
    """What an event is told as; None: it is not."""
    if event.kind == "state":
        return "job.ended" if STATES[event.body["state"]].terminal else None
    if event.kind != "alarm":
        return None
    topic = ALARMS.get(str(event.body.get("did")))
    # What is counted once more while it is open has been told.
    again = topic == "alarm.raised" and event.body.get("alarm", {}).get("count", 1) > 1
    return None if again else topic


def notice_of(event: Event, job: JobRow | None) -> Notice | None:
    """What is told of an event; ``job`` is its job, where it has one that is known."""
    topic = topic_of(event)
    if topic is None or event.number is None:
        return None
    body = event.body
    data: dict[str, Any] = {"event": event.number, "rig": event.rig, "job": event.job}
    if topic == "job.ended":
        data |= {name: body.get(name) for name in ("state", "ending", "cause")}
        if job is not None:
            data |= {name: getattr(job, name) for name in SAID}
        on = f" on {data['sample']}" if data.get("sample") else ""
        title = f"{data.get('kind', 'job')} {event.job}{on}: {body['state']}"
        title += f", {body['cause']}" if body.get("cause") else ""
    else:
        alarm = body.get("alarm", {})
        data |= {name: body.get(name) for name in ("cause", "words")}
        data |= {"alarm": alarm.get("id"), "severity": alarm.get("severity")}
        how = "over" if topic == "alarm.cleared" else data["severity"] or "alarm"
        title = f"{how}: {body.get('words')}"
    return Notice(event.number, topic, event.at, f"{event.rig}: {title}", data)
