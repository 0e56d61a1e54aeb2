"""Traces of jobs through a real collector of OpenTelemetry: Rotel, which is installed from a
wheel."""

import gzip
import json
import platform
import subprocess
import sys
from base64 import b64decode
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import httpx
import pytest

from pincette_supervisor.traces import ENDPOINT, trace_senders
from tests.support.environments import environment, ran
from tests.support.receivers import http_receiver
from tests.support.rigs import free_ports

from .harness import Harness
from .test_notify import deliver
from .test_traces import CALLER, SAMPLED, TRACE, attributes, sent

WANTED = ("rotel==0.0.1a15", "opentelemetry-proto==1.45.2")
PATIENCE_S = 60.0
DECODED = """
import sys
from google.protobuf.json_format import MessageToJson
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest
print(MessageToJson(ExportTraceServiceRequest.FromString(open(sys.argv[1], "rb").read())))
"""
pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(
        (sys.platform, platform.machine()) != ("linux", "x86_64"),
        reason="the wheels of the collector are for Linux on x86-64",
    ),
]


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment with the collector."""
    return environment(tmp_path_factory.mktemp("collector") / "venv", *WANTED)


@contextmanager
def collector(python: Path, out: int) -> Generator[int]:
    """Run the collector, which exports what it gets to a port; its own port for HTTP."""
    port = free_ports(2)
    (program,) = python.parents[1].glob("lib/*/site-packages/rotel/rotel-agent")
    words = ["--otlp-http-endpoint", f"127.0.0.1:{port}"]
    words += ["--otlp-grpc-endpoint", f"127.0.0.1:{port + 1}", "--disable-batching"]
    words += ["--exporter", "otlp", "--otlp-exporter-protocol", "http"]
    words += ["--otlp-exporter-endpoint", f"http://127.0.0.1:{out}"]
    with subprocess.Popen([str(program), "start", *words]) as process:
        try:
            deadline = monotonic() + PATIENCE_S
            while not _answers(port):
                assert process.poll() is None
                assert monotonic() < deadline
                sleep(0.05)
            yield port
        finally:
            process.kill()


def _answers(port: int) -> bool:
    try:
        httpx.get(f"http://127.0.0.1:{port}/", trust_env=False)
    except httpx.TransportError:
        return False
    return True


def test_a_collector_receives_the_spans_of_a_job_and_forwards_them(
    harness: Harness, python: Path, tmp_path: Path
) -> None:
    with http_receiver([200] * 9) as beyond, collector(python, beyond.port) as port:
        (sender,) = trace_senders({ENDPOINT: f"http://127.0.0.1:{port}"}, harness.store)
        delivery, _ = deliver(harness.store, sender)
        job = harness.freed(sent(harness, SAMPLED)["id"])
        harness.until(lambda: bool(harness.told("record", job=job["id"])))
        delivery.work()
        deadline = monotonic() + PATIENCE_S
        while not beyond.posts:
            assert monotonic() < deadline
            sleep(0.05)
        refused = httpx.post(f"http://127.0.0.1:{port}/v1/traces", json={"resourceSpans": 1})
    assert refused.status_code == 400  # it reads what it takes
    headers, body = beyond.posts[0]
    passed = tmp_path / "request"
    packed = headers.get("content-encoding") == "gzip"
    passed.write_bytes(gzip.decompress(body) if packed else body)
    request: dict[str, Any] = json.loads(ran([str(python), "-c", DECODED, str(passed)]))
    (resource,) = request["resourceSpans"]
    assert attributes(resource["resource"])["service.name"] == "pincette"
    (scoped,) = resource["scopeSpans"]
    root, *others = scoped["spans"]
    assert b64decode(root["traceId"]).hex() == TRACE
    assert b64decode(root["parentSpanId"]).hex() == CALLER
    assert {one["parentSpanId"] for one in others} == {root["spanId"]}
    assert [one["name"] for one in others][:4] == ["queue", "plan", "ready", "arm"]
    assert root["status"] == {"code": "STATUS_CODE_OK"}
    found = attributes(root)
    assert found["pincette.job"] == job["id"]
    assert found["pincette.force_held_mN"] == job["result"]["force_held_mN"]
