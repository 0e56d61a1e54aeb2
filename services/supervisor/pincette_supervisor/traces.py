"""Traces of jobs: spans from the journal, sent over OTLP after the record of a job is written.

The spans are created afterwards, so that they do not affect the loop. They are sent as OTLP in JSON
over HTTP, in the same way as notices: in order, and repeated while the collector does not reply.
"""

import hashlib
import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any, NamedTuple
from urllib.parse import unquote

from pincette import __version__
from pincette.api.events import Event
from pincette.config.notify import Told
from pincette_supervisor.journal.store import JobRow, Store
from pincette_supervisor.notify import Notice, RefusedError, post

log = logging.getLogger("pincette")
ENDPOINT, TRACES_ENDPOINT = "OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"
HEADERS = "OTEL_EXPORTER_OTLP_HEADERS"
"""Environment variables of OpenTelemetry: the address of the collector, the address for traces
alone, and further headers as NAME=VALUE,NAME=VALUE.
"""
AGAIN = (408, 429)
"""Statuses below 500 after which a request is repeated."""
MOST_EVENTS = 5000
FIGURES = (
    "outcome",
    "force_held_mN",
    "force_uncertainty_mN",
    "peak_force_mN",
    "contact_x_um",
    "contact_stiffness_mN_per_um",
    "place_um",
)
"""Members of a result that are attributes of the trace."""
WAITS: Mapping[str, str] = {
    "proposed": "approval",
    "queued": "queue",
    "preparing": "plan",
    "ready": "ready",
    "running": "arm",
    "awaiting_recovery": "recovery",
}
"""Names of the spans of states; each span ends with the next one, or with the first phase."""
OK, ERROR = 1, 2


class Span(NamedTuple):
    """Time interval of a job."""

    name: str
    begin: str
    """Time in the form of the journal, like ``end``."""
    end: str
    attributes: dict[str, Any]


def spans_of(job: JobRow, events: Sequence[Event]) -> list[Span]:
    """Return the spans of a job: the job, then queue, plan, arming, phases, recovery, record."""
    marks = [(name, event) for event in events if (name := _begun(event)) is not None]
    ended_at = job.ended_at or events[-1].at
    ends = [event.at for _, event in marks[1:]] + [ended_at]
    found = [
        Span(name, event.at, max(end, event.at), _attributes(event))
        for (name, event), end in zip(marks, ends, strict=True)
    ]
    records = [event for event in events if event.kind == "record"]
    if records:
        last = records[-1]
        complete = {"pincette.complete": bool(last.body.get("complete"))}
        found.append(Span("record", ended_at, max(ended_at, last.at), complete))
    values, result = job.plan.get("values", {}), job.result or {}
    about: dict[str, Any] = {
        "job": job.id,
        "rig": job.rig,
        "state": job.state,
        "sample": job.sample,
        "force_mN": values.get("force_mN"),
        **{f"label.{name}": text for name, text in job.labels.items()},
        **{name: result.get(name) for name in FIGURES},
    }
    given = {f"pincette.{name}": value for name, value in about.items() if value not in (None, "")}
    end = max(span.end for span in found) if found else ended_at
    return [Span(job.kind, job.created_at, end, given), *found]


def _begun(event: Event) -> str | None:
    """Return the name of the span that begins with an event; None if none does."""
    if event.kind == "phase":
        return str(event.body["phase"])
    return WAITS.get(event.body["state"]) if event.kind == "state" else None


def _attributes(event: Event) -> dict[str, Any]:
    return {f"pincette.{name}": event.body[name] for name in ("seq", "held") if name in event.body}


def request_of(job: JobRow, events: Sequence[Event]) -> dict[str, Any]:
    """Return the request that sends the spans of a job, as OTLP in JSON."""
    resource = {"service.name": "pincette", "service.instance.id": job.rig}
    scope = {"name": "pincette", "version": __version__}
    spans = [*_encoded(job, spans_of(job, events))]
    scoped = [{"scope": scope, "spans": spans}]
    return {"resourceSpans": [{"resource": {"attributes": _pairs(resource)}, "scopeSpans": scoped}]}


def _encoded(job: JobRow, spans: Sequence[Span]) -> Iterator[dict[str, Any]]:
    """Yield spans as OTLP; their ids depend on the job alone, so that a repeated span can be
    recognised."""
    trace, parent = _digest(job.id, 32), ""
    if job.traceparent is not None:
        _, trace, parent, _ = job.traceparent.split("-")
    root = _digest(f"{job.id} 0", 16)
    status = {"code": OK} if job.state == "succeeded" else {"code": ERROR, "message": job.cause}
    for number, span in enumerate(spans):
        yield {
            "traceId": trace,
            "spanId": _digest(f"{job.id} {number}", 16),
            "parentSpanId": root if number else parent,
            "name": span.name,
            "kind": 1,
            "startTimeUnixNano": _nanoseconds(span.begin),
            "endTimeUnixNano": _nanoseconds(span.end),
            "attributes": _pairs(span.attributes),
            "status": {} if number else status,
        }


def _digest(text: str, digits: int) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:digits]


def _nanoseconds(at: str) -> str:
    return str(int(datetime.fromisoformat(at).timestamp() * 1000.0 + 0.5) * 1_000_000)


def _pairs(values: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [{"key": name, "value": _value(value)} for name, value in values.items()]


def _value(value: Any) -> dict[str, Any]:
    if isinstance(value, bool):
        return {"boolValue": value}
    if isinstance(value, int):
        return {"intValue": str(value)}
    return {"doubleValue": value} if isinstance(value, float) else {"stringValue": str(value)}


def _is_sampled(job: JobRow) -> bool:
    """Return True if the caller records its trace or sent no trace context."""
    return job.traceparent is None or bool(int(job.traceparent[-2:], 16) & 1)


class TraceSender:
    """Sends the trace of each job to a collector."""

    events: tuple[Told, ...] = ("job.ended", "job.recorded")

    def __init__(self, url: str, headers: Mapping[str, str], store: Store) -> None:
        self._url, self._headers, self._store = url, headers, store
        self.name = f"traces {url}"

    def send(self, notice: Notice) -> None:
        """Send the trace of a job whose record is written, or that has none."""
        job = self._store.get(notice.data["job"])
        if job is None or not _is_sampled(job):
            return
        if notice.type == "job.ended" and job.epoch is not None:
            return  # the event of its record follows
        if job.plan.get("record", {}).get("open"):
            return  # a part is held: the record is closed when it is released
        events = self._store.events_after(0, job=job.id, limit=MOST_EVENTS)
        body = json.dumps(request_of(job, events), ensure_ascii=False).encode()
        status = post(self._url, body, {"Content-Type": "application/json", **self._headers})
        if status >= 500 or status in AGAIN:
            raise RefusedError(f"status {status}")
        if not 200 <= status < 300:
            log.warning("%s: the trace of job %s is refused: status %d", self.name, job.id, status)


def trace_senders(environment: Mapping[str, str], store: Store) -> list[TraceSender]:
    """Return the sender of traces that the environment configures; none without an address."""
    base, url = environment.get(ENDPOINT, ""), environment.get(TRACES_ENDPOINT, "")
    url = url or (f"{base.rstrip('/')}/v1/traces" if base else "")
    pairs = [pair.partition("=") for pair in environment.get(HEADERS, "").split(",") if pair]
    headers = {name.strip(): unquote(value.strip()) for name, _, value in pairs}
    return [TraceSender(url, headers, store)] if url else []
