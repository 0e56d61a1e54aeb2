"""The tutorial of the tray: a camera, a series, missing beads, verdicts, one report, one trace."""

import json
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette_supervisor.traces import ENDPOINT
from tests.support.checkout import ROOT, environment, run, until_interrupted
from tests.support.receivers import Received, http_receiver
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig

EXAMPLES = ROOT / "docs/examples"
PATIENCE_S = 400.0
"""A rig in lockstep is as slow as the machine is loaded."""
SEATS, MISSING = 12, (4, 9)


@pytest.fixture
def collector() -> Generator[Received]:
    with http_receiver() as received:
        yield received


@pytest.fixture
def rig(
    tmp_path: Path, collector: Received, monkeypatch: pytest.MonkeyPatch
) -> Generator[RunningRig]:
    monkeypatch.setenv(ENDPOINT, f"http://127.0.0.1:{collector.port}")
    tray = demo_rig({"simulation": {"scripts": True}}, time="lockstep")
    with running_rig(tray, tmp_path) as up:
        yield up


@contextmanager
def camera(rig: RunningRig) -> Generator[None]:
    """Run the example publisher for the rig, until the block ends."""
    words = ["--router", f"tcp/{rig.rig.bus.host}:{rig.rig.bus.port}", "--x-um", "31.2"]
    command = [sys.executable, str(EXAMPLES / "place.py"), *words]
    with subprocess.Popen(command, env=environment()) as process:
        try:
            deadline = monotonic() + PATIENCE_S
            while not rig.get("/rigs/demo/places")["newest"]:
                assert process.poll() is None
                assert monotonic() < deadline
                sleep(0.1)
            yield
        finally:
            process.terminate()


def roots_of(collector: Received) -> list[Json]:
    """The first span of each trace request: that of a job."""
    requests = [json.loads(body) for _, body in collector.posts]
    return [one["resourceSpans"][0]["scopeSpans"][0]["spans"][0] for one in requests]


def attributes(span: Json) -> Json:
    return {one["key"]: next(iter(one["value"].values())) for one in span["attributes"]}


def test_a_tray_with_two_missing_beads_is_gripped_reported_and_traced(
    rig: RunningRig, collector: Received, tmp_path: Path
) -> None:
    report = tmp_path / "tray.html"
    command = [sys.executable, str(EXAMPLES / "tray.py"), "--url", rig.rig.supervisor.url]
    command += ["--missing", *map(str, MISSING), "--report", str(report)]
    with camera(rig):
        done = run(command, tmp_path, PATIENCE_S)
    assert done.returncode == 0, done.stdout
    (found,) = rig.get("/series")["series"]
    series = rig.get(f"/series/{found['id']}")
    assert (series["state"], series["ended"], series["failed"]) == ("completed", SEATS, 0)
    assert [one["tries"] for one in series["jobs"]] == [
        1 + (number in MISSING) for number in range(1, SEATS + 1)
    ]

    jobs = rig.get("/jobs", label=f"series={series['id']}", limit=100)["jobs"]
    assert Counter(job["state"] for job in jobs) == {"succeeded": SEATS, "failed": len(MISSING)}
    for job in (rig.job(one["id"]) for one in jobs):
        assert job["traceparent"] == series["traceparent"]
        if job["state"] == "failed":
            assert job["ending"]["next_job"]
            assert job["sample"] in {f"B{number}" for number in MISSING}
            assert job["result"]["outcome"] in ("no_contact", "lost")
            continue
        result = job["result"]
        assert result["release"]["verdict"] == "released"
        assert abs(result["place"]["difference_um"]) < result["place"]["uncertainty_um"]
        assert abs(result["force_held_mN"] - 8.0) < result["force_uncertainty_mN"]

    trace = series["traceparent"].split("-")[1]
    page = report.read_text(encoding="utf-8")
    assert trace in page
    assert len(re.findall(r"<td[^>]*>released</td>", page)) == SEATS

    deadline = monotonic() + PATIENCE_S
    while len(roots := roots_of(collector)) < len(jobs):
        assert monotonic() < deadline
        sleep(0.1)
    assert {attributes(root)["pincette.job"] for root in roots} == {job["id"] for job in jobs}
    assert {root["traceId"] for root in roots} == {trace}
    assert {root["parentSpanId"] for root in roots} == {series["traceparent"].split("-")[2]}


def test_ctrl_c_ends_the_program_and_the_series_goes_on(rig: RunningRig, tmp_path: Path) -> None:
    log = tmp_path / "log"
    command = [sys.executable, str(EXAMPLES / "tray.py"), "--url", rig.rig.supervisor.url]
    with camera(rig), until_interrupted(command, tmp_path, log) as process:
        deadline = monotonic() + PATIENCE_S
        while not rig.get("/jobs")["jobs"]:
            assert process.poll() is None, log.read_text(encoding="utf-8")
            assert monotonic() < deadline
            sleep(0.1)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 1
    assert "Traceback" not in log.read_text(encoding="utf-8")
    (series,) = rig.get("/series")["series"]
    assert series["state"] == "running"


def test_the_program_has_at_most_60_lines() -> None:
    assert len((EXAMPLES / "tray.py").read_text(encoding="utf-8").splitlines()) <= 60
