"""Traces of jobs: the context of a request, and the spans that a collector gets."""

import json
from typing import Any

import httpx
import pytest

from pincette_supervisor.notify import FIRST_DELAY_S
from pincette_supervisor.traces import ENDPOINT, HEADERS, TRACES_ENDPOINT, trace_senders
from tests.support.receivers import Received, http_receiver

from .harness import Harness
from .test_awaiting_recovery import decided, waiting
from .test_notify import deliver

TRACE, CALLER = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"
SAMPLED = f"00-{TRACE}-{CALLER}-01"
GRIP = {"kind": "grip", "autostart": True, "force_mN": 9.0, "sample": "B7"}


def sent(harness: Harness, traceparent: str, path: str = "/jobs", body: Any = GRIP) -> Any:
    headers = {"traceparent": traceparent}
    response: httpx.Response = harness.call("POST", f"/api/v1{path}", json=body, headers=headers)
    assert response.status_code == 201, response.text
    return response.json()


def to(received: Received, **more: str) -> dict[str, str]:
    return {ENDPOINT: f"http://127.0.0.1:{received.port}/", **more}


def spans(body: bytes) -> list[dict[str, Any]]:
    (resource,) = json.loads(body)["resourceSpans"]
    (scoped,) = resource["scopeSpans"]
    return scoped["spans"]


def attributes(span: dict[str, Any]) -> dict[str, Any]:
    return {one["key"]: next(iter(one["value"].values())) for one in span["attributes"]}


def test_a_job_keeps_the_context_of_its_request(harness: Harness) -> None:
    job = sent(harness, SAMPLED)
    assert job["traceparent"] == SAMPLED
    assert harness.ended(job["id"])["traceparent"] == SAMPLED
    states = harness.told("state", job=job["id"])
    assert {event.body["traceparent"] for event in states} == {SAMPLED}
    manifest = json.loads((harness.bus.records / job["id"] / "manifest.json").read_text("utf-8"))
    assert manifest["traceparent"] == SAMPLED
    series = sent(harness, SAMPLED, "/series", {"job": {"kind": "grip"}, "repeats": 2})
    harness.get(f"/series/{series['id']}", wait="over", timeout_s=30)
    jobs = harness.get("/jobs", label=f"series={series['id']}")["jobs"]
    assert [one["traceparent"] for one in jobs] == [SAMPLED] * 2


@pytest.mark.parametrize(
    "traceparent",
    [
        "",
        "x",
        SAMPLED.upper(),
        f"00-{'0' * 32}-{CALLER}-01",
        f"00-{TRACE}-{'0' * 16}-01",
        "a" * 900,
    ],
)
def test_an_invalid_context_is_ignored(harness: Harness, traceparent: str) -> None:
    assert sent(harness, traceparent)["traceparent"] is None


def test_the_spans_of_a_job_are_sent_once_its_record_is_written(harness: Harness) -> None:
    with http_receiver([503, 200]) as received:
        (sender,) = trace_senders(to(received, **{HEADERS: "a=1%202,b=3"}), harness.store)
        delivery, clock = deliver(harness.store, sender)
        job = harness.freed(sent(harness, SAMPLED)["id"])
        harness.until(lambda: bool(harness.told("record", job=job["id"])))
        delivery.work()
        clock.now_s += FIRST_DELAY_S
        delivery.work()
        delivery.work()
    (_, refused), (headers, body) = received.posts
    assert refused == body
    assert (headers["content-type"], headers["a"], headers["b"]) == ("application/json", "1 2", "3")
    root, *others = spans(body)
    assert (root["traceId"], root["parentSpanId"], root["name"]) == (TRACE, CALLER, "grip")
    assert {one["traceId"] for one in others} == {TRACE}
    assert {one["parentSpanId"] for one in others} == {root["spanId"]}
    assert len({one["spanId"] for one in (root, *others)}) == 1 + len(others)
    names = [one["name"] for one in others]
    assert names[:4] == ["queue", "plan", "ready", "arm"]
    assert {"load", "hold", "unload"} <= set(names)
    assert names[-1] == "record"
    for one in (root, *others):
        begin, end = int(one["startTimeUnixNano"]), int(one["endTimeUnixNano"])
        assert int(root["startTimeUnixNano"]) <= begin <= end <= int(root["endTimeUnixNano"])
    found = attributes(root)
    assert (found["pincette.job"], found["pincette.sample"]) == (job["id"], "B7")
    assert (found["pincette.force_mN"], found["pincette.outcome"]) == (9.0, "gripped")
    assert found["pincette.force_held_mN"] == job["result"]["force_held_mN"]
    assert attributes(others[names.index("hold")])["pincette.held"] is True
    assert root["status"] == {"code": 1}


@pytest.mark.parametrize(("traceparent", "count"), [(f"00-{TRACE}-{CALLER}-00", 0), ("", 1)])
def test_a_trace_that_its_caller_does_not_record_is_not_sent(
    harness: Harness, traceparent: str, count: int
) -> None:
    with http_receiver() as received:
        (sender,) = trace_senders(to(received), harness.store)
        delivery, _ = deliver(harness.store, sender)
        job = harness.freed(sent(harness, traceparent)["id"])
        harness.until(lambda: bool(harness.told("record", job=job["id"])))
        delivery.work()
    assert len(received.posts) == count


def test_the_wait_for_a_decision_is_a_span_after_those_of_the_motion(harness: Harness) -> None:
    with http_receiver() as received:
        (sender,) = trace_senders(to(received), harness.store)
        delivery, _ = deliver(harness.store, sender)
        job = waiting(harness)
        assert decided(harness, job, "give_up").status_code == 202
        harness.ended(job)
        harness.until(lambda: bool(harness.told("record", job=job)))
        delivery.work()
    ((_, body),) = received.posts
    root, *others = spans(body)
    assert root["status"]["code"] == 2
    assert [one["name"] for one in others][-2:] == ["recovery", "record"]
    begins = [int(one["startTimeUnixNano"]) for one in others]
    assert begins == sorted(begins)


def test_a_job_that_never_moved_has_a_trace_too(harness: Harness) -> None:
    with http_receiver([400]) as received:
        (sender,) = trace_senders(to(received), harness.store)
        delivery, _ = deliver(harness.store, sender)
        job = sent(harness, SAMPLED, body={**GRIP, "autostart": False})["id"]
        harness.reach(job, "ready")
        harness.acted(job, "stop")
        harness.freed(job)
        delivery.work()
        delivery.work()
    ((_, body),) = received.posts
    assert [one["name"] for one in spans(body)] == ["grip", "queue", "plan", "ready"]
    assert spans(body)[0]["status"]["code"] == 2


def test_the_address_for_traces_is_set_by_the_variables_of_opentelemetry(harness: Harness) -> None:
    assert trace_senders({}, harness.store) == []
    (sender,) = trace_senders({ENDPOINT: "http://a:4318"}, harness.store)
    assert sender.name == "traces http://a:4318/v1/traces"
    (sender,) = trace_senders({ENDPOINT: "http://a", TRACES_ENDPOINT: "http://b/t"}, harness.store)
    assert sender.name == "traces http://b/t"
