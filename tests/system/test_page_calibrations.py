"""A calibration from the page: measured, viewed, accepted or discarded, as the server reports
it."""

import subprocess
import sys
from collections.abc import Generator

import pytest
from playwright.sync_api import Browser

from pincette.config.reading import laid_over
from tests.support.browser import Visit, looked_at
from tests.support.grips import SHORT
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig

LONG_S = 90.0
"""Longest wait, in s: a rig in lockstep is as slow as the machine is loaded."""


@pytest.fixture(scope="module")
def rig(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    assert browser.is_connected()
    changes = laid_over(SHORT, {"simulation": {"scripts": True}})
    with running_rig(demo_rig(changes, time="lockstep"), tmp_path_factory.mktemp("rig")) as running:
        yield running


@pytest.fixture
def seen(rig: RunningRig, browser: Browser) -> Generator[Visit]:
    with looked_at(browser, rig.rig) as visited:
        visited.until("#fact-start", "can start", LONG_S)
        yield visited


def measure_noise(rig: RunningRig, seen: Visit) -> Json:
    """Calibrate the noise of the sensor from the page; returns the proposal."""
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


def test_an_accepted_proposal_is_used_and_can_be_reverted(rig: RunningRig, seen: Visit) -> None:
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
    seen.until_true(
        lambda: model_version(rig) == 0, "the values of the rig file are not in use again"
    )
    seen.until("#fact-model", "rig file")


def test_a_discarded_proposal_changes_nothing(rig: RunningRig, seen: Visit) -> None:
    version = model_version(rig)
    proposal = measure_noise(rig, seen)
    seen.page.click(f"[id='discard-{proposal['id']}']")
    seen.until("#calibration-done", "is unchanged")
    assert rig.get(f"/calibrations/{proposal['id']}")["state"] == "discarded"
    assert model_version(rig) == version
    seen.until_true(
        lambda: seen.page.locator(f"[id='accept-{proposal['id']}']").count() == 0,
        "the proposal can still be accepted",
    )


def test_a_motion_is_repeated_after_the_page_has_asked_to_remove_the_part(
    rig: RunningRig, seen: Visit
) -> None:
    body = {"kind": "grip", "autostart": True}
    assert rig.ended(rig.post("/jobs", body).json()["id"], LONG_S)["state"] == "succeeded"
    seen.until("#fact-start", "can start", LONG_S)
    seen.page.click("#tab-start")
    seen.page.select_option("#kind", "calibrate")
    seen.page.select_option("#field-calibration", "residual")
    assert seen.page.is_checked("#field-confirm")
    seen.page.locator("#start").scroll_into_view_if_needed()
    seen.page.click("#start")
    seen.until("#current .instruction", "remove the part", LONG_S)
    seen.until_true(lambda: wholly_seen(seen, "#current .instruction"), "nobody sees it")
    job = rig.get("/jobs", limit=1)["jobs"][0]["id"]
    order(rig, "remove")
    seen.page.click("#act-continue")
    seen.until("#current .instruction", "put the part back", LONG_S)
    order(rig, "place")
    seen.page.click("#act-continue")
    assert rig.ended(job, LONG_S)["state"] == "succeeded"
    seen.page.click("#tab-calibrations")
    seen.until(f"[id='proposal-{job}']", "the error of the free response is", LONG_S)
    # The server requires a box that is not ticked, too.
    seen.page.click("#tab-start")
    seen.page.select_option("#field-calibration", "residual")
    seen.page.uncheck("#field-confirm")
    seen.page.click("#start")
    seen.until_true(lambda: rig.get("/jobs", limit=1)["jobs"][0]["id"] != job, "no job came")
    assert rig.get("/jobs", limit=1)["jobs"][0]["request"]["confirm"] is False
    rig.ended(rig.get("/jobs", limit=1)["jobs"][0]["id"], LONG_S)


def order(rig: RunningRig, what: str) -> None:
    """Remove the part of the simulated rig, or place it."""
    words = [sys.executable, "-m", "pincette", "rig", "part", what, "--rig", str(rig.path)]
    subprocess.run(words, check=True, capture_output=True, timeout=60)


def wholly_seen(seen: Visit, place: str) -> bool:
    """Return whether an element is inside the visible area of its scrolled panel."""
    return bool(
        seen.page.locator(place).evaluate(
            """one => {
                const own = one.getBoundingClientRect();
                const panel = one.closest(".side").getBoundingClientRect();
                return own.top >= panel.top - 1 && own.bottom <= panel.bottom + 1;
            }"""
        )
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
