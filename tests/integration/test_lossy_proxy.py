"""A client that retries, through a proxy that delays, drops and repeats requests, starts one
job."""

import random
import threading
from collections.abc import Generator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from time import sleep
from typing import cast

import httpx
import pytest

from pincette.client import Supervisor
from tests.support.rigs import demo_rig
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

SEED, JOBS = 20240, 10
TIMEOUT_S, DELAY_S = 0.5, 0.7
FAULTS = ("none", "unsent", "lost", "hung up", "late", "twice", "bad gateway")
PASSED_ON = ("content-type", "idempotency-key")


class LossyProxy(ThreadingHTTPServer):
    """A proxy that passes requests on, each with its own fault."""

    daemon_threads = True

    def __init__(self, to: str, chance: random.Random) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.to, self._chance, self._turn = to, chance, threading.Lock()
        self.made: list[str] = []

    def fault(self) -> str:
        with self._turn:
            self.made.append(self._chance.choice(FAULTS))
            return self.made[-1]


class Handler(BaseHTTPRequestHandler):
    """One connection, which ends with its reply."""

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Say nothing."""

    def _passed(self) -> None:
        body = self.rfile.read(int(self.headers.get("content-length", 0)))
        proxy = cast(LossyProxy, self.server)
        fault = proxy.fault()
        if fault == "unsent":
            return
        if fault == "hung up":
            try:
                self._ask(body, 0.02)  # closed while the job is being planned
            except httpx.TransportError:
                return
        answer = self._ask(body, 60.0)
        if fault == "twice":
            answer = self._ask(body, 60.0)
        if fault == "lost":
            return
        if fault == "late":
            sleep(DELAY_S)
        self.send_response(502 if fault == "bad gateway" else answer.status_code)
        content = b"<html>" if fault == "bad gateway" else answer.content
        kind = "text/html" if fault == "bad gateway" else answer.headers["content-type"]
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def _ask(self, body: bytes, timeout_s: float) -> httpx.Response:
        headers = {name: self.headers[name] for name in PASSED_ON if name in self.headers}
        return httpx.request(
            self.command,
            cast(LossyProxy, self.server).to + self.path,
            content=body,
            headers=headers,
            timeout=timeout_s,
            trust_env=False,
        )

    do_GET = do_POST = _passed


@contextmanager
def lossy(to: str, chance: random.Random) -> Generator[LossyProxy]:
    proxy = LossyProxy(to, chance)
    thread = threading.Thread(target=proxy.serve_forever)
    thread.start()
    try:
        yield proxy
    finally:
        proxy.shutdown()
        thread.join()
        proxy.server_close()


@pytest.fixture
def desk(tmp_path: Path) -> Generator[Harness]:
    desk = Harness(demo_rig(time="lockstep"), tmp_path)
    yield desk
    desk.close()


def test_each_start_creates_one_job_over_a_proxy_that_loses_and_repeats_requests(
    desk: Harness,
) -> None:
    print(f"seed {SEED}")
    with served(desk.app) as address, lossy(address, random.Random(SEED)) as proxy:
        url = f"http://127.0.0.1:{proxy.server_address[1]}"
        with Supervisor(url, timeout_s=TIMEOUT_S, patience_s=60.0) as supervisor:
            rig = supervisor.rig("demo")
            started: list[str] = []
            for number in range(JOBS):
                job = rig.start("grip", queue=True, labels={"part": str(number)})
                assert job.job.labels == {"part": str(number)}
                assert desk.ended(job.id)["state"] == "succeeded"
                started.append(job.id)
    assert {"lost", "hung up", "late", "twice"} <= set(proxy.made)
    kept = desk.get("/jobs", limit=100)["jobs"]
    assert [job["id"] for job in reversed(kept)] == started
