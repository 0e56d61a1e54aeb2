"""The page in a real browser, with a rig of real processes."""

from collections.abc import Generator
from pathlib import Path
from time import monotonic

import pytest
from playwright.sync_api import Browser, BrowserContext

from tests.support.browser import Visit, keep_picture, origin_of, visit
from tests.support.running import RunningRig

TRIES = 3
TEN_SECONDS = "#window [data-seconds='10']"


@pytest.fixture(scope="module")
def rig(browser: Browser, paced: RunningRig) -> RunningRig:
    """Start the rig after the browser: without a browser it is not needed."""
    assert browser.is_connected()
    return paced


@pytest.fixture
def seen(rig: RunningRig, context: BrowserContext) -> Generator[Visit]:
    """Open the page of a rig that can start; afterwards check that nothing was loaded from
    elsewhere or failed."""
    make_ready(rig)
    visited = visit(context, origin_of(rig.rig))
    visited.until("#fact-start", "can start")
    yield visited
    assert visited.addresses
    assert visited.foreign() == []
    assert [error for error in visited.errors if "409" not in error] == []


def make_ready(rig: RunningRig) -> None:
    """Stop what an earlier test has left, and clear the latch."""
    deadline = monotonic() + 30.0
    while not (view := rig.view())["can_start"]:
        if view["active_job"]:
            rig.post(f"/jobs/{view['active_job']}/actions", {"type": "abort"})
        elif "reset" in view["allowed_actions"]:
            rig.post(f"/rigs/{rig.rig.rig.name}/reset", {"acknowledge": True})
        elif view["startable"]:  # a part is held, but by no job
            rig.post("/jobs", {"kind": "release", "autostart": True})
        assert monotonic() < deadline, view["reasons"]


def start_endless(seen: Visit) -> str:
    """Start a grip that holds until it is released; returns the job's id once it holds."""
    seen.page.click("#tab-start")
    seen.page.check("#field-until_released")
    for _ in range(TRIES):
        before = seen.text("#current-open")
        seen.page.click("#start")
        seen.until_true(
            lambda before=before: (
                seen.text("#current-open") != before
                and ("hold" in seen.text("#course") or "zero refused" in seen.text("#current"))
            ),
            "no grip reached its hold",
        )
        # An arm that still creeps back from the previous test cannot be zeroed yet.
        if "hold" in seen.text("#course"):
            break
    return seen.text("#current-open")


def until_tripped(rig: RunningRig, seen: Visit) -> None:
    """Wait until the rig itself reports that the emergency stop has acted."""
    seen.until_true(lambda: rig.view()["latch"]["cause"] == "estop", "the rig never tripped")


def figure(seen: Visit, row: int) -> str:
    return seen.page.locator("#readouts tr:visible .figure").nth(row).inner_text()


def test_a_grip_started_from_the_page_succeeds(
    rig: RunningRig,
    seen: Visit,
    pictures: Path,
) -> None:
    seen.page.reload()
    seen.until_true(
        lambda: seen.page.input_value("#field-force_mN") == "8",
        "the force of the rig file was not filled in",
    )
    seen.page.click(TEN_SECONDS)
    keep_picture(seen, pictures, "idle")
    seen.page.fill("#field-force_mN", "12")
    seen.page.fill("#field-hold_s", "3")
    seen.page.click("#start")
    seen.until("#current-state", "running")
    seen.until("#course", "hold")
    seen.until_true(
        lambda: abs(float(figure(seen, 1).replace("\u2212", "-")) - 12.0) < 2.0,
        "the displayed force did not reach 12 mN",
    )
    seen.until("#fact-part", "held")
    keep_picture(seen, pictures, "gripping")
    name = seen.text("#current-open")
    seen.until("#current-state", "succeeded")
    job = rig.ended(name)  # drawing the pictures takes long on a busy machine
    assert job["state"] == "succeeded"
    assert job["values"]["force_mN"] == 12.0
    seen.page.click("#tab-jobs")
    seen.page.click(f"[id='open-{name}']")
    seen.until("#job-detail", "gripped")
    shown = seen.text("#job-list tbody tr:first-child")
    assert f"{job['result']['force_held_mN']:.2f}" in shown
    picture = seen.page.locator("#job-detail img").first
    picture.scroll_into_view_if_needed()
    seen.until_true(
        lambda: picture.evaluate("image => image.naturalWidth") > 400, "the picture never came"
    )
    assert "samples.parquet" in seen.text("#job-detail")


def test_estop_in_a_hold_latches_until_a_person_resets(
    rig: RunningRig,
    seen: Visit,
    pictures: Path,
) -> None:
    name = start_endless(seen)
    seen.page.click(TEN_SECONDS)
    seen.page.click("#estop")
    seen.until("#estop-said", "confirmed by the actuator", 5.0)
    seen.until("#latch-cause", "emergency stop")
    seen.until("#current-state", "failed")
    assert rig.job(name)["state"] == "failed"
    seen.until("#fact-start", "cannot start")
    keep_picture(seen, pictures, "fault")
    seen.until_true(lambda: rig.view()["latch"]["state"] == "latched", "the freeze did not end")
    seen.page.click("#reset-open")
    seen.page.click("#reset button[type=submit]")
    assert rig.view()["latch"]["state"] == "latched", (
        "a reset must require a confirmation by a person"
    )
    seen.page.check("#reset-seen")
    seen.page.click("#reset button[type=submit]")
    seen.until("#fact-start", "can start")
    assert rig.view()["can_start"]
    assert seen.page.locator("#latch").is_hidden()


def test_estop_acts_on_press_even_if_the_pointer_moves_away(rig: RunningRig, seen: Visit) -> None:
    seen.page.hover("#estop")
    seen.page.mouse.down()
    seen.page.mouse.move(5, 500)
    seen.page.mouse.up()
    seen.until("#estop-said", "confirmed by the actuator", 5.0)
    until_tripped(rig, seen)


def test_estop_works_while_the_rest_of_the_server_is_slow(rig: RunningRig, seen: Visit) -> None:
    seen.page.route(
        "**/api/v1/**",
        lambda route: None if "estop" not in route.request.url else route.continue_(),
    )
    seen.until("#connection", "no answer for", 10.0)
    seen.page.click("#estop")
    seen.until("#estop-said", "confirmed by the actuator", 3.0)
    until_tripped(rig, seen)


def test_a_page_reload_during_a_job_keeps_the_displayed_state(rig: RunningRig, seen: Visit) -> None:
    name = start_endless(seen)
    seen.page.reload()
    seen.until("#course", "hold")
    assert seen.text("#current-open") == name
    assert seen.text("#current-state").endswith("running")
    seen.until_true(lambda: figure(seen, 1) != "–", "no force was displayed after the reload")
    seen.page.click("button[data-seconds='60']")
    seen.page.focus("#charts")
    before = ""
    while not before.endswith(("approach", "contact", "load")):  # each ended before the reload
        seen.page.keyboard.press("ArrowLeft")
        seen.until_true(
            lambda before=before: seen.text("#at") != before,
            "no sample from before the reload is displayed",
        )
        before = seen.text("#at")
    seen.page.click("#act-release")
    seen.until("#current-state", "succeeded")
    assert rig.job(name)["result"]["outcome"] == "released"


def test_a_plan_that_breaks_a_limit_is_reported_at_the_field(rig: RunningRig, seen: Visit) -> None:
    before = len(rig.get("/jobs")["jobs"])
    seen.page.fill("#field-force_mN", "55")
    seen.page.click("#dry-run")
    seen.until("#field-force_mN-fault", "limit 40 mN")
    assert seen.page.get_attribute("#field-force_mN", "aria-invalid") == "true"
    assert "Not feasible" in seen.text("#plan")
    seen.page.fill("#field-force_mN", "12")
    assert seen.page.locator("#field-force_mN-fault").is_hidden()
    seen.page.click("#dry-run")
    seen.until("#plan", "Feasible")
    assert seen.page.locator("#plan canvas").count() >= 3
    assert len(rig.get("/jobs")["jobs"]) == before
