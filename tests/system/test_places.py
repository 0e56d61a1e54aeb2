"""A vision client as a separate program, and jobs that use its position, over each interface."""

import subprocess
import sys
from collections.abc import Generator
from time import monotonic, sleep

import pytest
from playwright.sync_api import Browser

from pincette.client import Supervisor
from tests.support.browser import looked_at
from tests.support.checkout import ROOT, environment
from tests.support.commands import pincette
from tests.support.grips import make_ready
from tests.support.running import RunningRig

PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def published(lockstep: RunningRig) -> Generator[RunningRig]:
    """Run the example publisher beside a rig that can start."""
    rig, bus = lockstep, lockstep.rig.bus
    make_ready(rig, PATIENCE_S)
    words = ["--router", f"tcp/{bus.host}:{bus.port}", "--x-um", "6.0", "--u-um", "0.8"]
    camera = subprocess.Popen(
        [sys.executable, str(ROOT / "docs/examples/place.py"), *words], env=environment()
    )
    try:
        deadline = monotonic() + PATIENCE_S
        while not rig.get("/rigs/demo/places")["newest"]:
            assert camera.poll() is None
            assert monotonic() < deadline
            sleep(0.1)
        yield rig
    finally:
        camera.terminate()
        camera.wait(10.0)


def newest(rig: RunningRig) -> str:
    """Return the id of the newest job."""
    return str(rig.get("/jobs", limit=1)["jobs"][0]["id"])


def test_a_grip_uses_the_place_that_the_example_publishes(published: RunningRig) -> None:
    rig = published
    ended = rig.ended(rig.start_grip(place={"given_by": "bus", "max_age_s": 600.0}), PATIENCE_S)
    url = rig.rig.supervisor.url
    words = ["job", "grip", "--all", "--url", url]
    words += ["--place", "given_by=bus,source=camera-1,max_age_s=600"]
    typed = pincette(*words, timeout_s=PATIENCE_S)
    with Supervisor(url) as supervisor:
        places = supervisor.rig("demo").places()
    assert ended["state"] == "succeeded"
    found = ended["result"]["place"]
    assert found["difference_um"] == pytest.approx(0.2, abs=0.3)
    assert abs(found["difference_um"]) < found["uncertainty_um"]
    assert typed.returncode == 0, typed.stdout + typed.stderr
    assert "place found minus place given" in typed.stdout
    (bias,) = places.biases
    assert bias.count == 2
    assert bias.mean_um == pytest.approx(found["difference_um"], abs=0.1)


def test_a_grip_that_the_page_starts_uses_the_published_place(
    published: RunningRig, browser: Browser
) -> None:
    rig = published
    make_ready(rig, PATIENCE_S)
    with looked_at(browser, rig.rig) as seen:
        seen.until("#fact-start", "can start", PATIENCE_S)
        seen.page.select_option("#kind", "grip")
        seen.page.click("#more-fields summary")
        seen.page.select_option("#field-place-given_by", "bus")
        seen.page.fill("#field-place-max_age_s", "600")
        before = newest(rig)
        seen.page.click("#start")
        seen.until_true(lambda: newest(rig) != before, "no job came")
        job = rig.ended(newest(rig), PATIENCE_S)
        assert job["request"]["place"]["given_by"] == "bus"
        assert (job["state"], job["result"]["place"]["source"]) == ("succeeded", "camera-1")
        seen.page.click("#tab-jobs")
        seen.page.click(f"[id='open-{job['id']}']")
        seen.until("#job-detail", "place found minus place given", PATIENCE_S)
