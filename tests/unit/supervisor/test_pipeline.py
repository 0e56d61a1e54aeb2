"""From request to job: what is resolved and planned, and how often."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from pincette_supervisor.journal.library import RecipeRepository, RecipeRow
from pincette_supervisor.planning import job_plans
from pincette_supervisor.rigs.health import Health

from .canned import IN_HOLD
from .harness import Harness


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count plans, reads of recipes, and forced status requests."""
    done: Counter[str] = Counter()

    def count(owner: Any, name: str, counted: Callable[[dict[str, Any]], bool]) -> None:
        original = getattr(owner, name)

        def call(*values: Any, **named: Any) -> Any:
            done[name] += counted(named)
            return original(*values, **named)

        monkeypatch.setattr(owner, name, call)

    count(job_plans, "plan", lambda _named: True)
    count(RecipeRepository, "find", lambda _named: True)
    count(Health, "refresh", lambda named: named.get("force", False))
    return done


def keep_recipe(harness: Harness) -> None:
    stored = harness.post("/recipes", {"name": "bead", "values": {"force_mN": 18.0}})
    assert stored.status_code == 201, stored.text


def test_a_job_is_resolved_planned_and_admitted_once(harness: Harness, work: Counter[str]) -> None:
    """This also holds before the first sample, when the position of the arm is not known."""
    keep_recipe(harness)
    for _ in range(2):
        work.clear()
        job = harness.grip(recipe="bead")
        assert harness.freed(job["id"])["state"] == "succeeded"
        assert work == {"plan": 1, "find": 1, "refresh": 1}


def test_a_dry_run_is_resolved_and_planned_once(harness: Harness, work: Counter[str]) -> None:
    keep_recipe(harness)
    body = {"kind": "grip", "recipe": "bead"}
    assert harness.post("/jobs", body, dry_run=True).status_code == 200
    assert work == {"plan": 1, "find": 1}


def test_a_queued_job_is_planned_when_it_is_queued_and_when_it_starts(
    harness: Harness, work: Counter[str]
) -> None:
    keep_recipe(harness)
    first = harness.playing_to(IN_HOLD)
    work.clear()
    second = harness.grip(recipe="bead", queue=True)["id"]
    assert (work["plan"], work["find"]) == (1, 1)
    harness.bus.pause_at = None
    harness.bus.play()
    harness.ended(first)
    job = harness.ended(second)
    assert job["state"] == "succeeded", job["cause"]
    assert (work["plan"], work["find"]) == (2, 2)


def test_a_queued_job_with_an_invalid_recipe_fails_without_affecting_others(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An upgrade may refuse values that the version before has stored."""
    keep_recipe(harness)
    first = harness.playing_to(IN_HOLD)
    second = harness.grip(recipe="bead", queue=True)["id"]
    third = harness.grip(queue=True)["id"]
    find = RecipeRepository.find

    def outdated(book: RecipeRepository, reference: str) -> RecipeRow | None:
        row = find(book, reference)
        return None if row is None else replace(row, values={"force_mN": -1.0})

    monkeypatch.setattr(RecipeRepository, "find", outdated)
    harness.bus.pause_at = None
    harness.bus.play()
    harness.ended(first)
    failed = harness.ended(second)
    assert failed["state"] == "failed"
    assert failed["ending"]["code"] == "plan_refused"
    assert failed["ending"]["problem"] == "invalid-request"
    assert "bead@1" in failed["cause"]
    assert harness.get("/rigs/demo")["queue"]["halted"].startswith(f"job {second} failed: ")
    resumed = harness.post("/rigs/demo/queue/actions", {"type": "resume"})
    assert resumed.status_code == 200, resumed.text
    job = harness.ended(third)
    assert job["state"] == "succeeded", job["cause"]
