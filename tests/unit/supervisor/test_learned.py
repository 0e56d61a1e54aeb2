"""What programs have learned is kept by program, listed over REST, and erased by one request."""

from dataclasses import replace

import pytest

from pincette.control.planning.repetition import Corrections
from pincette_supervisor.journal.library import LEARNED_MAX, LearnedRepository, LearnedRow
from pincette_supervisor.journal.store import Store
from pincette_supervisor.plugin import RESIDUALS
from pincette_supervisor.plugin.model_in_use import merged

from .harness import Harness


def row(program: str, learned_at: str = "2026-03-01T12:00:00.000Z") -> LearnedRow:
    return LearnedRow(program, "job", learned_at, {"shape": "sinusoid"}, (0.1, -0.1), (0.3, 0.2))


@pytest.fixture
def repository(store: Store) -> LearnedRepository:
    return LearnedRepository(store, "demo")


def test_stored_corrections_are_read_back_unchanged(repository: LearnedRepository) -> None:
    assert repository.all() == []
    repository.keep(row("a"))
    found = repository.find("a")
    assert found == row("a")
    assert found is not None
    assert found.corrections == Corrections((0.1, -0.1), (0.3, 0.2))
    assert repository.find("b") is None


def test_one_program_or_all_can_be_erased(repository: LearnedRepository) -> None:
    for name in ("a", "b", "c"):
        repository.keep(row(name))
    assert repository.erase("b") == 1
    assert repository.erase("b") == 0
    assert {one.program for one in repository.all()} == {"a", "c"}
    assert repository.erase() == 2
    assert repository.all() == []


def test_a_learned_program_that_did_not_help_is_deleted(repository: LearnedRepository) -> None:
    repository.keep(row("a"))
    repository.forget("a")
    repository.forget("a")
    assert repository.find("a") is None


def test_the_program_that_learned_longest_ago_is_dropped(repository: LearnedRepository) -> None:
    for number in range(LEARNED_MAX + 1):
        repository.keep(row(f"{number}", f"2026-03-01T12:{number:02d}:00.000Z"))
    kept = repository.all()
    assert len(kept) == LEARNED_MAX
    assert repository.find("0") is None
    assert kept[0].program == f"{LEARNED_MAX}"


def test_each_rig_has_its_own_corrections(store: Store) -> None:
    demo, other = LearnedRepository(store, "demo"), LearnedRepository(store, "other")
    other.keep(row("a", "2026-01-01T12:00:00.000Z"))
    for number in range(LEARNED_MAX + 1):
        demo.keep(row("a" if number == LEARNED_MAX else f"{number}"))
    assert [one.program for one in other.all()] == ["a"]
    assert demo.erase() == LEARNED_MAX
    assert [one.program for one in other.all()] == ["a"]


def test_new_corrections_of_a_program_replace_its_earlier_ones(
    repository: LearnedRepository,
) -> None:
    repository.keep(row("a"))
    later = replace(row("a", "2026-03-02T12:00:00.000Z"), best_um=(0.5,), quiet=3)
    repository.keep(later)
    assert repository.all() == [later]


def test_a_residual_table_replaces_only_the_earlier_table_of_the_same_program() -> None:
    def table(program: str, job: str) -> dict[str, str]:
        return {"program": program, "job": job}

    before = merged({}, {RESIDUALS: [table("a", "1"), table("b", "1")]}, "2026-03-01")
    after = merged(before, {RESIDUALS: [table("a", "2")]}, "2026-03-02")
    assert [(one["program"], one["job"], one["measured_at"]) for one in after[RESIDUALS]] == [
        ("b", "1", "2026-03-01"),
        ("a", "2", "2026-03-02"),
    ]
    assert merged(before, {"model.piezo_um_per_V": 19.0}, "") == {"model.piezo_um_per_V": 19.0}


def test_learning_is_listed_and_erased_over_rest(harness: Harness) -> None:
    repository = LearnedRepository(harness.store, harness.manager.name)
    name = "0123456789abcdef"
    repository.keep(row(name))
    path = f"/rigs/{harness.manager.name}/learning"
    (found,) = harness.get(path)["programs"]
    assert (found["program"], found["cycles"], found["over"]) == (name, 2, False)
    assert found["errors_um"] == [0.3, 0.2]
    erased = harness.call("DELETE", f"/api/v1{path}/{name}")
    assert erased.status_code == 200, erased.text
    assert erased.json()["erased"] == 1
    assert harness.call("DELETE", f"/api/v1{path}/{name}").status_code == 404
    assert harness.call("DELETE", f"/api/v1{path}").json()["erased"] == 0
