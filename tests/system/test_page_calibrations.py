"""A calibration from the page: measured, looked at, accepted or discarded, as the server says."""

from collections.abc import Generator

import pytest
from playwright.sync_api import Browser

from tests.support.browser import Visit, looked_at
from tests.support.grips import SHORT
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig

LONG_S = 90.0
"""A rig in lockstep is as slow as the machine is loaded."""


@pytest.fixture(scope="module")
def rig(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    assert browser.is_connected()
    with running_rig(demo_rig(SHORT, time="lockstep"), tmp_path_factory.mktemp("rig")) as running:
        yield running


@pytest.fixture
def seen(rig: RunningRig, browser: Browser) -> Generator[Visit]:
    with looked_at(browser, rig.rig) as visited:
        visited.until("#fact-start", "can start", LONG_S)
        yield visited


def measure_noise(rig: RunningRig, seen: Visit) -> Json:
    """Calibrate the noise of the sensor from the page; what it proposes."""
    before = rig.get("/calibrations")["calibrations"]
    seen.page.click("#tab-start")
    seen.page.select_option("#kind", "calibrate")
    seen.page.fill("#field-duration_s", "2")
    seen.page.click("#start")
    seen.until_true(
        lambda: len(rig.get("/calibrations")["calibrations"]) > len(before),
        "nothing was proposed",
        LONG_S,
    )
    proposal: Json = rig.get("/calibrations")["calibrations"][0]
    seen.page.click("#tab-calibrations")
    seen.until(f"[id='proposal-{proposal['id']}']", "proposed", LONG_S)
    return proposal


def model_version(rig: RunningRig) -> int:
    return int(rig.get(f"/rigs/{rig.rig.rig.name}/model")["version"])


def test_what_is_accepted_is_used_and_can_be_taken_back(rig: RunningRig, seen: Visit) -> None:
    proposal = measure_noise(rig, seen)
    place = f"[id='proposal-{proposal['id']}']"
    value = proposal["values"][0]
    shown = seen.text(f"{place} table")
    assert f"{value['difference_percent']:.2g}".lstrip("-") in shown
    assert "In use" in shown
    picture = seen.page.locator(f"{place} img")
    picture.scroll_into_view_if_needed()
    seen.until_true(
        lambda: picture.evaluate("image => image.naturalWidth") > 400, "the picture never came"
    )
    assert model_version(rig) == 0
    seen.page.click(f"[id='accept-{proposal['id']}']")
    seen.until("#calibration-done", "version 1 of the model is in use")
    assert rig.get(f"/calibrations/{proposal['id']}")["state"] == "accepted"
    assert model_version(rig) == 1
    seen.until("#fact-model", "version 1")
    seen.page.click("#tab-rig")
    seen.page.click("#use-0")
    seen.until_true(lambda: model_version(rig) == 0, "the rig file is not used again")
    seen.until("#fact-model", "rig file")


def test_what_is_discarded_changes_nothing(rig: RunningRig, seen: Visit) -> None:
    version = model_version(rig)
    proposal = measure_noise(rig, seen)
    seen.page.click(f"[id='discard-{proposal['id']}']")
    seen.until("#calibration-done", "stays as it is")
    assert rig.get(f"/calibrations/{proposal['id']}")["state"] == "discarded"
    assert model_version(rig) == version
    seen.until_true(
        lambda: seen.page.locator(f"[id='accept-{proposal['id']}']").count() == 0,
        "it can still be accepted",
    )


def test_the_checklist_starts_and_accepts_what_is_next(rig: RunningRig, seen: Visit) -> None:
    path = f"/rigs/{rig.rig.rig.name}/checklist"
    seen.page.click("#tab-calibrations")
    seen.until("#step-frequency_response", "no buffered acquisition", LONG_S)
    seen.page.click("#step-start-noise")
    seen.until("#step-noise", "Accept", LONG_S)
    seen.page.click("#step-accept-noise")
    seen.until("#step-noise", "done", LONG_S)
    seen.until("#step-noise", "noise", LONG_S)
    seen.until("#step-compliance", "next", LONG_S)
    assert rig.get(path)["next"] == "compliance"
