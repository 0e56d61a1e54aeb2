"""Lists of jobs: each job equals that of its own address, however often the list was read
before."""

from typing import Any

from pincette.api.jobs import JobList
from pincette_supervisor.fleet.rigs import SettledJobs

from .canned import IN_HOLD
from .harness import Harness


def listed(harness: Harness, **query: Any) -> list[dict[str, Any]]:
    return harness.get("/jobs", **query)["jobs"]


def as_found_alone(harness: Harness, jobs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [harness.get(f"/jobs/{job['id']}") for job in jobs]


def ended_jobs(harness: Harness, count: int) -> list[str]:
    names = [str(harness.grip()["id"])]
    harness.freed(names[0])
    for _ in range(count - 1):
        names.append(str(harness.grip()["id"]))
        harness.freed(names[-1])
    return names


def test_a_repeated_list_request_contains_every_change(harness: Harness) -> None:
    first, second = ended_jobs(harness, 2)
    before = listed(harness)
    assert [job["id"] for job in before] == [second, first]
    assert before == as_found_alone(harness, before)
    assert listed(harness) == before
    harness.call("PATCH", f"/api/v1/jobs/{first}", json={"notes": "chipped"})
    edited = listed(harness)
    assert edited[1]["notes"] == "chipped"
    assert edited == as_found_alone(harness, edited)
    assert harness.call("DELETE", f"/api/v1/jobs/{second}/record").status_code == 200
    deleted = listed(harness)
    assert deleted[0]["artifacts"] == "deleted"
    assert deleted == as_found_alone(harness, deleted)


def test_a_list_has_the_progress_of_the_live_job(harness: Harness) -> None:
    ended_jobs(harness, 1)
    live = harness.playing_to(IN_HOLD)
    running = listed(harness)
    assert running[0]["state"] == "running"
    assert running == as_found_alone(harness, running)
    waiting = str(harness.grip(queue=True)["id"])
    assert listed(harness)[0]["position"] == 1
    harness.acted(live, "stop")
    harness.freed(live)
    harness.acted(waiting, "stop")
    stopped = listed(harness)
    assert [job["state"] for job in stopped] == ["stopped", "stopped", "succeeded"]
    assert stopped == as_found_alone(harness, stopped)


def test_a_list_is_encoded_according_to_its_schema(harness: Harness) -> None:
    names = ended_jobs(harness, 2)
    for limit, following in ((1, names[1]), (2, None)):
        answer = harness.call("GET", "/api/v1/jobs", params={"limit": limit})
        assert answer.headers["content-type"] == "application/json"
        stated = JobList.model_validate_json(answer.content)
        assert len(stated.jobs) == limit
        assert stated.next == following
        assert answer.content == stated.model_dump_json(by_alias=True).encode()


def test_jobs_are_cached_at_one_revision_and_the_least_recently_used_is_dropped() -> None:
    settled = SettledJobs(most=2)
    settled.add("a", 3, b"a3")
    settled.add("b", 5, b"b5")
    assert settled.find([("a", 3), ("b", 4), ("c", 1)]) == {"a": b"a3"}
    settled.add("c", 1, b"c1")
    assert settled.find([("a", 3), ("b", 5), ("c", 1)]) == {"a": b"a3", "c": b"c1"}
    settled.add("a", 4, b"a4")
    assert settled.find([("a", 3)]) == {}
    assert settled.find([("a", 4), ("c", 1)]) == {"a": b"a4", "c": b"c1"}


def test_a_job_that_reaches_the_journal_late_is_not_listed_in_an_old_state(
    harness: Harness,
) -> None:
    (name,) = ended_jobs(harness, 1)
    live = harness.manager.index.newest
    assert live is not None
    # The journal has not taken the last change of the live job yet.
    before = live.status
    live.update(revision=before.revision + 1, cause="a full disk")
    assert listed(harness)[0]["cause"] == "a full disk"
    live.update(revision=before.revision, cause=before.cause)
    harness.store.change(name, cause="the disk has room again")
    assert listed(harness)[0]["cause"] == "the disk has room again"
