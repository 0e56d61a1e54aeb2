"""Why a job has ended: a code with numbers at every end, beside the words."""

from typing import Any, get_args

import pytest

from pincette.api.endings import ENDINGS, EndingCode
from pincette.api.results import OutcomeCode
from pincette.core.faults import Outcome
from pincette_supervisor.plugin import Planned

from .canned import IN_APPROACH, IN_HOLD
from .harness import Harness

PLAIN: dict[str, Any] = {"trip": "", "faults": [], "values": {}, "problem": ""}


def test_every_code_has_a_meaning_and_every_outcome_is_typed() -> None:
    assert set(ENDINGS) == set(get_args(EndingCode))
    told = {str(outcome) for outcome in Outcome if outcome}
    assert set(get_args(OutcomeCode)) == told | {"tripped", "unfinished"}


def test_a_job_that_is_done_and_one_that_runs(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD)
    assert harness.get(f"/jobs/{job}")["ending"] is None
    harness.bus.play()
    assert harness.ended(job)["ending"] == {"code": "done", **PLAIN}
    told = [row.body.get("ending") for row in harness.told("state", job=job)]
    assert told[-1] == "done"
    assert set(told[:-1]) == {None}


@pytest.mark.parametrize("action", ["stop", "abort"])
def test_what_a_person_asked_for(harness: Harness, action: str) -> None:
    job = harness.playing_to(IN_APPROACH)
    harness.acted(job, action)
    assert harness.ended(job)["ending"] == {"code": "requested", **PLAIN}


def test_a_trip_is_told_with_its_cause_and_its_numbers(harness: Harness) -> None:
    job = harness.playing_to(IN_APPROACH)
    harness.bus.trip("command_age: late")
    failed = harness.ended(job)
    assert failed["state"] == "failed"
    ending = failed["ending"]
    assert (ending["code"], ending["trip"]) == ("tripped", "command_age")
    (found,) = ending["faults"]
    assert found["code"] == "no_command"
    assert found["values"] == {"silent_s": 0.051, "limit_s": 0.05}
    assert failed["result"]["outcome"] == "tripped"


def test_a_queued_job_whose_plan_is_refused_names_the_problem(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_plan(*_given: object) -> Planned:
        raise ValueError("out of reach")

    first = harness.playing_to(IN_HOLD)
    second = harness.grip(queue=True)["id"]
    monkeypatch.setattr("pincette_supervisor.planning.job_plans.plan", no_plan)
    harness.bus.play()
    harness.ended(first)
    ending = harness.ended(second)["ending"]
    assert ending == {**PLAIN, "code": "plan_refused", "problem": "invalid-request"}


def test_a_cleared_queue(harness: Harness) -> None:
    harness.playing_to(IN_HOLD)
    second = harness.grip(queue=True)["id"]
    assert harness.post("/rigs/demo/queue/actions", {"type": "clear"}).status_code == 200
    assert harness.get(f"/jobs/{second}")["ending"]["code"] == "queue_cleared"


def test_a_limit_that_is_broken_is_told_in_codes(harness: Harness) -> None:
    refused = harness.post("/jobs", {"kind": "grip", "force_mN": 60.0}).json()
    assert {(one["quantity"], one["side"]) for one in refused["violations"]} >= {("force", "above")}
    assert all(one["value"] > one["limit"] for one in refused["violations"])
