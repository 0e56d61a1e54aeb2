"""A job whose grip did not succeed waits for a decision, if its request asks for that."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import httpx
import pytest

from pincette.api.states import JobState
from pincette.config import RigFile
from pincette.control.record import replace
from pincette.core.faults import Outcome
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.jobs import tracker
from tests.support.apps import create_app
from tests.support.keys import key_of_each_scope

from .canned import IN_HOLD
from .harness import Harness
from .samples import Tick
from .test_series import begun, failing, numbers, over

RECOVERY = {"wait_s": 600.0}
STATE: JobState = "awaiting_recovery"


def waiting(harness: Harness, outcome: Outcome = Outcome.NO_CONTACT, **wishes: Any) -> str:
    """Return a job that waits for a decision on its first grip; later grips succeed."""
    harness.bus.edit = ending_with(outcome)
    job = str(harness.grip(**{"recovery": RECOVERY, **wishes})["id"])
    harness.reach(job, STATE)
    return job


def ending_with(outcome: Outcome) -> Callable[[list[Tick]], list[Tick]]:
    played = [0]

    def edit(ticks: list[Tick]) -> list[Tick]:
        played[0] += 1
        if played[0] > 1:
            return ticks
        return [
            tick
            if tick.telemetry.outcome is Outcome.NONE
            else replace(tick, telemetry=replace(tick.telemetry, outcome=outcome))
            for tick in ticks
        ]

    return edit


def decided(harness: Harness, job: str, decision: str, **members: Any) -> httpx.Response:
    body = {"type": decision, **members}
    return harness.call("POST", f"/api/v1/jobs/{job}/actions", json=body)


def place(x_um: float) -> dict[str, Any]:
    at = datetime.now(UTC).isoformat(timespec="milliseconds")
    return {"x_um": x_um, "u_um": 0.5, "measured_at": at, "source": "camera-1"}


def test_a_job_that_found_no_part_waits_and_lists_the_possible_decisions(harness: Harness) -> None:
    job = waiting(harness)
    view = harness.get(f"/jobs/{job}")
    assert view["state"] == STATE
    assert view["recovery"]["case"] == "no_contact"
    assert view["result"]["outcome"] == "no_contact"
    assert view["ending"] is None
    reported = [event.body for event in harness.told("state", job=job)][-1]
    assert (reported["state"], reported["case"]) == (STATE, "no_contact")
    assert harness.post("/jobs", {"kind": "grip"}).status_code == 409
    assert decided(harness, job, "give_up").status_code == 202
    ended = harness.ended(job)
    assert (ended["state"], ended["ending"]["code"]) == ("failed", "bad_outcome")
    assert ended["recovery"] is None
    assert [(one["type"], one["by"]) for one in ended["actions"]][-1][0] == "give_up"
    assert ended["record_complete"]


def test_the_ending_of_a_retried_job_contains_the_id_of_the_new_job(harness: Harness) -> None:
    job = waiting(harness, sample="B7")
    assert decided(harness, job, "retry").status_code == 202
    ended = harness.get(f"/jobs/{job}", wait="terminal", timeout_s=30)
    assert ended["state"] == "failed"
    again = harness.ended(ended["ending"]["next_job"])
    assert (again["state"], again["sample"]) == ("succeeded", "B7")
    assert again["id"] != job


def test_a_retry_at_a_place_beyond_the_limits_is_refused_and_the_job_still_waits(
    harness: Harness,
) -> None:
    job = waiting(harness)
    assert decided(harness, job, "retry_at").status_code == 422
    assert decided(harness, job, "retry", place=place(30.0)).status_code == 422
    old = {**place(30.0), "measured_at": "2026-03-01T12:00:00.000Z"}
    assert decided(harness, job, "retry_at", place=old).status_code == 409
    assert decided(harness, job, "retry_at", place=place(5000.0)).status_code == 422
    assert harness.get(f"/jobs/{job}")["state"] == STATE


def test_a_second_decision_about_the_same_job_is_refused(harness: Harness) -> None:
    job = waiting(harness)
    assert decided(harness, job, "give_up").status_code == 202
    refused = decided(harness, job, "retry")
    assert refused.status_code == 409
    assert refused.json()["allowed_actions"] == []
    assert harness.ended(job)["ending"]["next_job"] == ""


@pytest.mark.parametrize(("action", "state"), [("stop", "stopped"), ("abort", "aborted")])
def test_a_stop_or_an_abort_ends_the_wait(harness: Harness, action: str, state: str) -> None:
    job = waiting(harness)
    assert decided(harness, job, action).status_code == 202
    assert harness.ended(job)["state"] == state
    assert harness.bus.trips == []


def test_the_default_decision_accept_gives_up_if_nothing_was_held(harness: Harness) -> None:
    harness.bus.edit = failing(1)
    job = str(harness.grip(recovery={"wait_s": 0.05, "default": "accept"})["id"])
    ended = harness.ended(job)
    assert "accept" not in [one["type"] for one in ended["actions"]]
    assert (ended["state"], ended["ending"]["code"]) == ("failed", "bad_outcome")
    assert decided(harness, job, "give_up").status_code == 409


def test_a_held_force_can_be_accepted_before_the_progress_contains_it(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tracker, "SETTLE_S", 1e3)
    job = waiting(harness, Outcome.LOST)
    view = harness.get(f"/jobs/{job}")
    assert view["progress"]["force_held_mN"] is None
    assert view["result"]["force_held_mN"] is not None
    assert "accept" in view["recovery"]["decisions"]


def test_a_job_whose_part_was_lost_in_the_hold_can_be_accepted(harness: Harness) -> None:
    job = waiting(harness, Outcome.LOST)
    view = harness.get(f"/jobs/{job}")
    assert view["recovery"]["decisions"] == ["retry", "retry_at", "accept", "give_up"]
    assert decided(harness, job, "accept").status_code == 202
    ended = harness.ended(job)
    assert (ended["state"], ended["ending"]["code"]) == ("succeeded", "accepted")
    assert (ended["cause"], ended["result"]["outcome"]) == ("", "lost")


def test_the_default_repeats_the_job_as_often_as_requested(harness: Harness) -> None:
    harness.bus.edit = failing(1, 2, 3)
    recovery = {"wait_s": 0.05, "default": "retry", "tries": 2}
    first = harness.ended(str(harness.grip(recovery=recovery)["id"]))
    second = harness.ended(first["ending"]["next_job"])
    third = harness.ended(second["ending"]["next_job"])
    assert third["ending"]["next_job"] == ""
    assert [one["type"] for one in third["actions"]][-1] == "give_up"


@pytest.mark.parametrize(("tries", "safe"), [(1, False), (0, True)])
def test_a_rig_that_waits_for_a_decision_is_safe_to_approach_unless_the_default_repeats_the_job(
    harness: Harness, tries: int, safe: bool
) -> None:
    job = waiting(harness, recovery={**RECOVERY, "default": "retry", "tries": tries})
    assert harness.get(f"/jobs/{job}")["recovery"]["default"] == ("give_up" if safe else "retry")
    assert harness.get("/rigs/demo")["safe_to_move"]["value"] is safe


def test_an_emergency_stop_ends_the_wait(harness: Harness) -> None:
    job = waiting(harness)
    assert harness.post("/rigs/demo/estop").status_code in (200, 202)
    ended = harness.ended(job)
    assert (ended["state"], ended["ending"]["code"]) == ("failed", "tripped")


def test_a_job_without_recovery_ends_at_once(harness: Harness) -> None:
    harness.bus.edit = failing(1)
    assert harness.ended(str(harness.grip()["id"]))["state"] == "failed"


def test_the_end_of_the_supervisor_interrupts_a_wait(
    harness: Harness, rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    job = waiting(harness)
    harness.manager.close()
    after = open_harness(rig_file)
    assert after.ended(job)["state"] == "interrupted"


def test_a_key_that_may_only_observe_cannot_decide_about_recovery(harness: Harness) -> None:
    job = waiting(harness)
    access = Access(Authenticator())
    harness.app = create_app(harness.rigs, access)
    ring = key_of_each_scope(harness.store, access.authenticator)
    path, body = f"/api/v1/jobs/{job}/actions", {"type": "give_up"}
    answer = harness.call("POST", path, json=body, headers=ring.headers("observe"))
    assert answer.status_code == 403
    answer = harness.call("POST", path, json=body, headers=ring.headers("operate"))
    assert answer.status_code == 202


def test_a_series_goes_on_after_a_retry_and_after_giving_up(harness: Harness) -> None:
    harness.bus.edit = failing(1, 4)
    grip = {"kind": "grip", "hold_s": 0.5, "recovery": RECOVERY}
    series = begun(harness, job=grip, repeats=3, stop_after_failures=None)["id"]
    for decision in ("retry", "give_up"):
        harness.until(lambda: bool(waits(harness)))
        assert decided(harness, waits(harness), decision).status_code == 202
        harness.until(lambda: not waits(harness))
    found = over(harness, series)
    assert found["state"] == "completed"
    assert numbers(found) == [(1, "succeeded"), (2, "succeeded"), (3, "failed")]


def waits(harness: Harness) -> str:
    """Return the job that waits for a decision; empty if none does."""
    live = harness.manager.active
    return "" if live is None or live.status.state != STATE else live.id


def test_a_job_in_its_hold_accepts_no_recovery_decision(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD, recovery=RECOVERY)
    assert decided(harness, job, "accept").status_code == 409
