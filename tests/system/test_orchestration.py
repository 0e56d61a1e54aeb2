"""Counters, camera pictures, verdicts of releases and traces over REST, page, CLI and client.

All tests use one rig of real processes with a simulated camera.
"""

import json
from collections.abc import Callable, Generator
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest
from playwright.sync_api import Browser

from pincette.client import Supervisor
from pincette.config.reading import laid_over
from tests.support.browser import Visit, origin_of, visit
from tests.support.cameras import camera, mjpeg, painted
from tests.support.commands import pincette
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig

LONG_S = 120.0
"""Longest wait, in s: a rig in lockstep is as slow as the machine is loaded."""
PICTURE = painted("green")
PICTURES = [f"camera-{moment}.jpg" for moment in ("contact", "end", "hold")]
CONTACTS = 4
"""Contacts after which a calibration is due."""
TRACES = {
    way: f"00-{number:032x}-00f067aa0ba902b7-01"
    for number, way in enumerate(("rest", "cli", "client"), start=1)
}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    with camera(mjpeg(PICTURE)) as address:
        changes = {"supervisor": {"camera": address}, "calibration": {"valid_contacts": CONTACTS}}
        own = demo_rig(laid_over(SHORT, changes), time="lockstep")
        with running_rig(own, tmp_path_factory.mktemp("rig")) as running:
            yield running


@pytest.fixture(scope="module")
def supervisor(rig: RunningRig) -> Generator[Supervisor]:
    with Supervisor(rig.rig.supervisor.url) as opened:
        yield opened


@pytest.fixture(scope="module")
def page(rig: RunningRig, browser: Browser) -> Generator[Visit]:
    context = browser.new_context()
    yield visit(context, origin_of(rig.rig))
    context.close()


@pytest.fixture(scope="module")
def grips(rig: RunningRig, supervisor: Supervisor) -> dict[str, str]:
    """Grip once by each way that accepts a trace context; returns the ids of the jobs."""
    make_ready(rig, LONG_S)
    headers = {"traceparent": TRACES["rest"]}
    body = {"kind": "grip", "autostart": True}
    posted = rig.client.post("/jobs", json=body, headers=headers).raise_for_status().json()
    rig.ended(posted["id"], LONG_S)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRACEPARENT", TRACES["cli"])
        typed = command(rig, "job", "grip")
    started = supervisor.rig("demo").start("grip", traceparent=TRACES["client"])
    found = {"rest": posted["id"], "cli": typed["id"], "client": started.id}
    for name in found.values():
        assert rig.ended(name, LONG_S)["state"] == "succeeded"
    return found


def command(rig: RunningRig, *words: str) -> Any:
    """Return the JSON output of a command that succeeds."""
    done = pincette(*words, "--json", "--url", rig.rig.supervisor.url, timeout_s=LONG_S)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)


def open_job(page: Visit, job: str) -> None:
    page.page.click("#tab-jobs")
    page.page.click(f"[id='open-{job}']")
    page.until("#job-title", job, LONG_S)


def test_a_trace_context_is_returned_by_each_interface(
    rig: RunningRig, supervisor: Supervisor, page: Visit, grips: dict[str, str]
) -> None:
    for way, job in grips.items():
        assert rig.job(job)["traceparent"] == TRACES[way]
        assert supervisor.job(job).job.traceparent == TRACES[way]
        assert command(rig, "job", "show", job)["traceparent"] == TRACES[way]
        open_job(page, job)
        page.until("#job-trace", TRACES[way].split("-")[1])


def test_pictures_of_contact_hold_and_end_are_in_the_record(
    rig: RunningRig,
    supervisor: Supervisor,
    page: Visit,
    grips: dict[str, str],
    tmp_path: Path,
) -> None:
    job = grips["client"]
    listed = rig.get(f"/jobs/{job}/artifacts")["artifacts"]
    assert [one["name"] for one in listed if one["media_type"] == "image/jpeg"] == PICTURES
    for name in PICTURES:
        got = rig.client.get(f"/jobs/{job}/artifacts/{name}").raise_for_status()
        assert got.content == PICTURE
    saved = supervisor.job(job).download("camera-hold.jpg", tmp_path)
    assert saved.read_bytes() == PICTURE
    (typed,) = command(rig, "records", "get", job, "camera-end.jpg", "--out", str(tmp_path))
    assert Path(typed).read_bytes() == PICTURE

    open_job(page, job)
    for name in PICTURES:
        shown = page.page.locator(f"#job-detail img[src$='{name}']")
        shown.scroll_into_view_if_needed()
        page.until_true(
            lambda shown=shown: shown.evaluate("image => image.naturalWidth") == 320, name
        )
        assert name.removesuffix(".jpg").removeprefix("camera-") in (
            shown.get_attribute("alt") or ""
        )


@pytest.mark.parametrize("way", ["client", "cli", "rest", "page"])
def test_a_release_states_its_verdict(
    rig: RunningRig, supervisor: Supervisor, page: Visit, way: str
) -> None:
    make_ready(rig, LONG_S)
    held = rig.start_grip(until_released=True)
    rig.until_phase(held, "hold", LONG_S)
    command(rig, "stop")
    rig.ended(held, LONG_S)
    if way == "client":
        supervisor.rig("demo").start("release", strategies=["retreat", "dither"])
    elif way == "cli":
        command(rig, "job", "release", "--strategies", "retreat; dither")
    elif way == "rest":
        body = {"kind": "release", "autostart": True, "strategies": ["retreat", "dither"]}
        rig.post("/jobs", body).raise_for_status()
    else:
        page.page.click("#tab-start")
        page.page.select_option("#kind", "release")
        page.page.fill("#field-strategies", "retreat; dither")
        page.page.click("#start")
        page.until_true(lambda: newest(rig) != held, "no job came", LONG_S)
    released = newest(rig)
    found = rig.ended(released, LONG_S)["result"]["release"]
    assert (found["verdict"], found["strategies"]) == ("released", ["retreat"])
    assert command(rig, "job", "show", released)["result"]["release"] == found
    assert (supervisor.job(released).job.result or {})["release"] == found
    open_job(page, released)
    page.until("#job-detail", "released")


@pytest.mark.usefixtures("grips")
def test_counters_make_a_calibration_due_until_one_is_accepted(
    rig: RunningRig, supervisor: Supervisor, page: Visit
) -> None:
    while (use := rig.view()["use"])["contacts"] < CONTACTS:
        assert "contacts" not in use["due"]
        assert rig.ended(rig.start_grip(), LONG_S)["state"] == "succeeded"
    assert use["strokes"] >= use["contacts"]
    assert use["hours"] > 0.0
    own = supervisor.rig("demo")
    assert use["due"] == ["contacts"]
    known = own.state().use
    assert known is not None
    assert known.model_dump() == use
    assert command(rig, "rigs", "demo")["use"] == use

    def alarms() -> list[Json]:
        return rig.get("/alarms", open="true")["alarms"]

    until(alarms, "no alarm")
    (alarm,) = alarms()
    assert (alarm["cause"], alarm["severity"]) == ("calibration.due", "warning")
    assert [one.id for one in supervisor.alarms(open=True).alarms] == [alarm["id"]]
    (typed,) = command(rig, "alarms")["alarms"]
    assert typed["id"] == alarm["id"]
    page.page.click("#tab-rig")
    page.until("#rig-checks", f"{use['contacts']} contacts")
    page.until("#reasons", f"limit {CONTACTS}")
    page.until("#alarms", "calibrat")

    job = own.start("calibrate", calibration="noise", duration_s=2.0)
    assert job.wait(LONG_S).state == "succeeded"
    supervisor.decide(job.id, "accept")
    begun = rig.view()["use"]
    assert (begun["contacts"], begun["due"]) == (0, [])
    until(lambda: all(one["cleared_at"] for one in alarms()), "the alarm is not cleared")
    page.until("#rig-checks", "0 contacts")


def newest(rig: RunningRig) -> str:
    return rig.get("/jobs", limit=1)["jobs"][0]["id"]


def until(there: Callable[[], object], words: str) -> None:
    began_s = monotonic()
    while not there():
        assert monotonic() - began_s < LONG_S, words
        sleep(0.1)
