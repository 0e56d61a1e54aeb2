"""Jobs of every kind from the page, at a rig in lockstep: the state of the server is checked."""

from collections.abc import Generator
from datetime import UTC, datetime
from typing import Any

import pytest
from playwright.sync_api import Browser

from pincette.core.topics import LOOP
from tests.support.browser import Visit, looked_at
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import demo_rig
from tests.support.running import Json, RunningRig, running_rig

LONG_S = 90.0
"""A rig in lockstep is as slow as the machine is loaded."""
TRIES = 3
SLOWLY = {name: seed for seed, name in enumerate(LOOP)}


@pytest.fixture(scope="module")
def rig(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    """Start a rig whose ticks take some ms each, so that an endless hold floods no client with
    samples."""
    assert browser.is_connected()
    folder = tmp_path_factory.mktemp("rig")
    with running_rig(demo_rig(SHORT, time="lockstep"), folder, SLOWLY) as running:
        yield running


@pytest.fixture
def seen(rig: RunningRig, browser: Browser) -> Generator[Visit]:
    """Open the page of a rig that can start; a job that a test leaves is ended."""
    make_ready(rig, LONG_S)
    with looked_at(browser, rig.rig) as visited:
        visited.until("#fact-start", "can start")
        visited.until_true(
            lambda: visited.page.input_value("#field-force_mN") == "8", "no defaults came"
        )
        yield visited
    make_ready(rig, LONG_S)


def ids(rig: RunningRig) -> list[str]:
    """Return the jobs of the server, the newest first."""
    return [job["id"] for job in rig.get("/jobs", limit=3)["jobs"]]


def until_state(rig: RunningRig, seen: Visit, name: str, state: str) -> Json:
    """Wait until the server reports a state of a job; returns the job."""
    seen.until_true(
        lambda: rig.job(name)["state"] == state, f"{name} never was {state}", timeout_s=LONG_S
    )
    return rig.job(name)


def choose(seen: Visit, kind: str, **fields: str) -> None:
    seen.page.select_option("#kind", kind)
    for name, value in fields.items():
        seen.page.fill(f"#field-{name}", value)


def press_start(rig: RunningRig, seen: Visit) -> str:
    """Start the job of the form; returns the id that the server gives it."""
    return made_by(rig, seen, "#start")


def made_by(rig: RunningRig, seen: Visit, button: str) -> str:
    """Return the id of the job that the server creates when a button is pressed."""
    before = ids(rig)
    seen.page.click(button)
    seen.until_true(lambda: ids(rig) != before, "no job came")
    return ids(rig)[0]


def grip_until_held(rig: RunningRig, seen: Visit) -> str:
    """Start a grip that holds until it is released, and wait for the hold; returns the job's id."""
    job: Json = {}
    for _ in range(TRIES):
        choose(seen, "grip")
        seen.page.check("#field-until_released")
        name = press_start(rig, seen)
        seen.until_true(lambda name=name: holds_or_ended(rig, name), "it never held", LONG_S)
        job = rig.job(name)
        # An arm that still creeps back from the previous test cannot be zeroed yet.
        if job["ended_at"] is None:
            return name
    raise TimeoutError(f"no grip reached its hold: {job['cause']}")


def holds_or_ended(rig: RunningRig, name: str) -> bool:
    job = rig.job(name)
    progress: Json = job["progress"] or {}
    return job["ended_at"] is not None or progress.get("phase") == "hold"


def test_a_job_is_paused_resumed_stopped_and_its_part_released(
    rig: RunningRig, seen: Visit
) -> None:
    name = grip_until_held(rig, seen)
    seen.page.click("#act-pause")
    until_state(rig, seen, name, "paused")
    seen.until("#current-state", "paused")
    seen.page.click("#act-resume")
    until_state(rig, seen, name, "running")
    seen.page.click("#act-stop")
    job = until_state(rig, seen, name, "stopped")
    assert [action["type"] for action in job["actions"]] == ["pause", "resume", "stop"]
    assert rig.view()["part"] == "held"
    seen.page.click("#act-release")
    seen.until("#fact-start", "can start", LONG_S)
    assert rig.view()["part"] == "none"


def test_a_button_press_is_not_lost_if_the_job_changes_meanwhile(
    rig: RunningRig, seen: Visit
) -> None:
    name = grip_until_held(rig, seen)
    seen.page.click("#act-pause")
    seen.until("#current-state", "paused")
    seen.page.hover("#act-stop")
    seen.page.mouse.down()
    rig.post(f"/jobs/{name}/actions", {"type": "resume"}).raise_for_status()
    until_state(rig, seen, name, "running")
    seen.page.wait_for_timeout(1000.0)  # the page has received the change
    seen.page.mouse.up()
    until_state(rig, seen, name, "stopped")
    seen.until("#current-state", "stopped")


def test_a_grip_without_its_part_waits_and_is_repeated_at_another_place(
    rig: RunningRig, seen: Visit
) -> None:
    place = {"x_um": 3.0, "u_um": 0.5, "source": "person"}
    place |= {"measured_at": datetime.now(UTC).isoformat(), "max_age_s": LONG_S}
    name = rig.start_grip(place=place, recovery={"wait_s": 3600.0})
    until_state(rig, seen, name, "awaiting_recovery")
    seen.until("#recovery-wait", "no contact")
    shown = seen.text("#recovery-wait")
    seen.until_true(lambda: seen.text("#recovery-wait") != shown, "nothing counts down")
    assert seen.page.locator("#act-accept").count() == 0
    assert seen.page.is_enabled("#act-give_up")
    seen.page.fill("#retry-x", "4.0")
    seen.page.click("#act-retry_at")
    job = until_state(rig, seen, name, "failed")
    assert [action["type"] for action in job["actions"]] == ["retry_at"]
    seen.until_true(lambda: bool(rig.job(name)["ending"]["next_job"]), "no job repeats it", LONG_S)
    again = rig.job(name)["ending"]["next_job"]
    job = until_state(rig, seen, again, "awaiting_recovery")  # there is no part either
    assert job["request"]["place"]["x_um"] == 4.0
    seen.page.wait_for_selector(f'#current-open:text("{again}")')
    seen.page.click("#act-give_up")
    assert until_state(rig, seen, again, "failed")["ending"]["next_job"] == ""


def test_a_part_kept_by_a_stop_is_held_further_and_released_by_jobs(
    rig: RunningRig, seen: Visit
) -> None:
    name = grip_until_held(rig, seen)
    seen.page.click("#act-stop")
    until_state(rig, seen, name, "stopped")
    seen.until("#kind-hint", "only hold or release", LONG_S)
    choose(seen, "hold", release_s="0.5")
    assert seen.text("#kind-hint") == ""
    held = press_start(rig, seen)
    until_state(rig, seen, held, "running")
    assert rig.job(held)["kind"] == "hold"
    seen.until("#current-state", "running")
    seen.page.click("#act-stop")
    until_state(rig, seen, held, "stopped")
    choose(seen, "release", release_s="0.4")
    released = rig.ended(press_start(rig, seen), LONG_S)
    assert (released["kind"], released["state"]) == ("release", "succeeded")
    assert rig.view()["part"] == "none"


def test_jobs_wait_in_the_queue_and_are_removed_or_cleared(rig: RunningRig, seen: Visit) -> None:
    running = grip_until_held(rig, seen)
    choose(seen, "move", value="3")
    seen.page.check("#field-queue")
    assert seen.text("#start") == "Add to the queue"
    waiting: list[str] = []
    for place in (1, 2, 3):
        waiting.append(press_start(rig, seen))
        assert rig.job(waiting[-1])["position"] == place
    seen.until(f"#queue li:has([id='wait-{waiting[1]}'])", "move to 3.00 µm")
    seen.page.click(f"[id='drop-{waiting[0]}']")
    until_state(rig, seen, waiting[0], "stopped")
    assert rig.job(waiting[1])["position"] == 1
    seen.page.click(f"[id='drop-{waiting[1]}']")
    until_state(rig, seen, waiting[1], "stopped")
    seen.until("#queue", "1 of 16")
    seen.page.click("#queue-clear")
    assert until_state(rig, seen, waiting[2], "stopped")["cause"] == "the queue was cleared"
    seen.until_true(lambda: seen.page.locator("#queue").is_hidden(), "the queue is still shown")
    assert rig.job(running)["state"] == "running"


def test_a_person_approves_one_proposed_job_and_rejects_another(
    rig: RunningRig, seen: Visit
) -> None:
    rejected, approved = (rig.start_grip(approval_s=3600.0) for _ in range(2))
    seen.until("#proposed-title", "Waits for approval")
    seen.page.click(f"[id='reject-{rejected}']")
    assert until_state(rig, seen, rejected, "stopped")["ending"]["code"] == "rejected"
    assert rig.job(approved)["state"] == "proposed"
    seen.page.click(f"[id='approve-{approved}']")
    assert until_state(rig, seen, approved, "succeeded")["actions"][0]["type"] == "approve"
    seen.until_true(lambda: seen.page.locator("#queue").is_hidden(), "the queue is still shown")


def test_a_halted_queue_states_why_and_continues_when_a_person_resumes_it(
    rig: RunningRig, seen: Visit
) -> None:
    running = grip_until_held(rig, seen)
    choose(seen, "move", value="2")
    seen.page.check("#field-queue")
    waiting = press_start(rig, seen)
    seen.page.click("#act-abort")
    until_state(rig, seen, running, "aborted")
    seen.until("#queue-halted", running, LONG_S)
    seen.until_true(
        lambda: "reset" in rig.view()["allowed_actions"], "a reset is not an allowed action", LONG_S
    )
    seen.page.click("#reset-open")
    seen.page.check("#reset-seen")
    seen.page.click("#reset button[type=submit]")
    seen.until_true(lambda: not rig.view()["latch"]["cause"], "the latch never cleared", LONG_S)
    assert rig.job(waiting)["state"] == "queued"
    seen.page.click("#queue-resume")
    seen.until_true(lambda: not rig.view()["queue"]["halted"], "the queue is still halted")


def test_the_arm_can_be_jogged_and_a_pose_taught(rig: RunningRig, seen: Visit) -> None:
    choose(seen, "move")
    seen.page.select_option("#jog-step", label="0.5 µm")
    step = rig.ended(made_by(rig, seen, "#jog-more"), LONG_S)
    assert (step["state"], step["request"]["by_um"]) == ("succeeded", 0.5)
    seen.until("#jog-said", f"at {step['result']['ends_at']['x_um']:.2f}", LONG_S)
    seen.page.fill("#jog-name", "beside the bead")
    seen.page.click("#jog-teach")
    seen.until("#jog-said", "letters, digits")
    seen.page.fill("#jog-name", "beside-the-bead")
    taught = rig.ended(made_by(rig, seen, "#jog-teach"), LONG_S)["result"]
    seen.until("#poses", "beside-the-bead", LONG_S)
    assert taught["teach"] == "beside-the-bead"
    assert taught["ends_at"]["voltage_V"] == pytest.approx(step["result"]["ends_at"]["voltage_V"])
    seen.page.click("[id='pose-beside-the-bead']")
    assert float(seen.page.input_value("#field-value")) == pytest.approx(
        taught["ends_at"]["x_um"], abs=6e-4
    )


def test_a_path_of_steps_is_requested_with_the_values_of_the_fields(
    rig: RunningRig, seen: Visit
) -> None:
    choose(seen, "track")
    assert seen.page.locator("#field-frequency_hz").is_visible()
    seen.page.select_option("#field-shape", "step")
    assert seen.page.locator("#field-frequency_hz").is_hidden()
    seen.page.fill("#field-levels_mN", "4, 6")
    seen.page.fill("#field-dwell_s", "0.3")
    seen.page.click("#more-fields summary")
    seen.page.select_option("#field-on_stop", "retract")
    job = rig.job(press_start(rig, seen))
    values = {"shape": "step", "levels_mN": [4, 6], "dwell_s": 0.3, "on_stop": "retract"}
    assert values.items() <= job["request"].items()
    assert job["rig"] == rig.rig.rig.name


@pytest.mark.parametrize(
    "kind", ["grip", "track", "move", "hold", "release", "calibrate", "characterise"]
)
def test_every_kind_is_predicted_before_it_starts(rig: RunningRig, seen: Visit, kind: str) -> None:
    before = ids(rig)
    fields = {"value": "3"} if kind == "move" else {}
    choose(seen, kind, **fields)
    body: Json = {"kind": kind, **({"to_um": 3.0} if fields else {})}
    if kind == "calibrate":
        body["calibration"] = "noise"
    seen.page.click("#dry-run")
    seen.until("#plan", "easible", LONG_S)
    plan: dict[str, Any] = rig.post("/jobs?dry_run=true", body).raise_for_status().json()
    assert ("Not feasible" not in seen.text("#plan .verdict")) == plan["feasible"]
    assert seen.page.locator("#plan canvas").count() >= 3
    margins = len(plan["prediction"]["margins"]) if plan["prediction"] else 0
    assert seen.page.locator("#plan tbody tr").count() == margins
    assert ids(rig) == before


def test_a_data_sheet_starts_with_the_values_of_its_form(rig: RunningRig, seen: Visit) -> None:
    choose(seen, "characterise", force_mN="6", noise_s="2")
    job = rig.job(press_start(rig, seen))
    assert (job["kind"], job["state"] in ("failed", "proposed")) == ("characterise", False)
    assert {"force_mN": 6, "noise_s": 2}.items() <= job["request"].items()
    assert (job["values"]["force_mN"], job["values"]["noise_s"]) == (6.0, 2.0)


def test_a_move_beyond_the_limits_names_them_with_their_phases(
    rig: RunningRig, seen: Visit
) -> None:
    before = ids(rig)
    choose(seen, "move", value="90")
    seen.page.click("#dry-run")
    seen.until("#field-value-fault", "limit 70 µm", LONG_S)
    assert seen.page.locator("#plan .violations li").count() >= 1
    seen.page.click("#start")
    seen.until("#start-said", "breaks a limit", LONG_S)
    assert ids(rig) == before
    assert all("422" in error for error in seen.errors), seen.errors
    seen.errors.clear()


def test_the_page_plans_starts_and_reports_a_series_based_on_its_form(
    rig: RunningRig, seen: Visit
) -> None:
    choose(seen, "grip")
    seen.page.click("#series-new summary")
    seen.page.fill("#series-csv", "sample,force_mN\nB1,x\n")
    seen.page.click("#series-dry-run")
    seen.until("#series-said", "force_mN = 'x' mN")
    assert all("422" in error for error in seen.errors)
    seen.errors.clear()
    seen.page.fill("#series-csv", "sample,force_mN\nB1,8\nB2,9\n")
    seen.page.fill("#series-failures", "")
    seen.page.click("#series-dry-run")
    seen.until("#series-planned", "2 jobs can be done", LONG_S)
    seen.page.click("#series-start")
    seen.until("#series-progress", "2 of 2 jobs ended", LONG_S)
    seen.until("#series", "completed", LONG_S)
    (series,) = rig.get("/series", limit=1)["series"]
    assert series["state"] == "completed"
    assert seen.page.locator("#series a").count() == 3
    seen.page.click("#series-job")
    seen.until("#job-title", series["job"])
