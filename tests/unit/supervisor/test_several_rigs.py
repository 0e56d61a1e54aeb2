"""Several rigs under one supervisor: they appear and disappear, and each is run separately."""

import asyncio
import threading
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import sleep
from typing import Any

import httpx
import pytest

from pincette.bus.protocol import BusError
from pincette.bus.stopping import MOST_AT_ONCE, trip_each
from pincette.config import RigFile
from pincette.core.topics import LOOP
from pincette_supervisor.fleet import rig_finder, rigs
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.rigs import health
from pincette_supervisor.rigs.latch import StopOfOthers
from tests.support.apps import create_app

from . import samples
from .canned import IN_HOLD
from .harness import PATIENCE_S
from .rigs_harness import RigsHarness, joined


@dataclass
class Files:
    left: RigFile
    right: RigFile


@pytest.fixture
def files(rig_file: RigFile) -> Files:
    left = rig_file.model_copy(update={"rig": rig_file.rig.model_copy(update={"name": "left"})})
    return Files(left, joined(left, "right"))


@pytest.fixture
def rigs_harness(
    files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[RigsHarness]:
    monkeypatch.setattr(rig_finder, "SETTLE_S", 0.01)
    monkeypatch.setattr(rig_finder, "AGAIN_S", 0.02)
    monkeypatch.setattr(health, "FRESH_S", 0.0)
    made = RigsHarness(files.left, tmp_path)
    yield made
    made.close()


@pytest.fixture
def both(rigs_harness: RigsHarness, files: Files) -> RigsHarness:
    rigs_harness.come(files.right)
    rigs_harness.served("right")
    return rigs_harness


def refusal(response: Any) -> tuple[int, str]:
    return response.status_code, response.json()["detail"]


def test_a_rig_that_joins_may_state_that_its_supervisor_speaks_tls(
    rigs_harness: RigsHarness, files: Files
) -> None:
    supervisor = files.right.supervisor.model_copy(update={"tls": True})
    rigs_harness.come(files.right.model_copy(update={"supervisor": supervisor}))
    rigs_harness.served("right")


def test_a_rig_whose_programs_appear_is_served_beside_the_own_rig(
    both: RigsHarness, files: Files
) -> None:
    assert both.names() == ["left", "right"]
    assert both.get("/rigs/right")["digest"] == files.right.digest()
    assert both.found("right") == ["found"]
    assert both.call("GET", "/version").json()["rigs"] == {
        "left": files.left.digest(),
        "right": files.right.digest(),
    }


def test_jobs_of_both_rigs_run_at_once(both: RigsHarness) -> None:
    waiting = both.playing_to(IN_HOLD, rig="left")
    right = both.ended(both.grip(rig="right")["id"])
    assert right["state"] == "succeeded"
    assert both.get(f"/jobs/{waiting}")["state"] == "running"
    both.canned["left"].play()
    assert both.ended(waiting)["state"] == "succeeded"
    assert [job["rig"] for job in both.get("/jobs")["jobs"]] == ["right", "left"]
    assert [job["id"] for job in both.get("/jobs", rig="left")["jobs"]] == [waiting]


@pytest.mark.parametrize("path", ["/jobs", "/trajectories", "/trajectories/plot", "/calibrations"])
def test_a_request_without_a_rig_is_refused_and_the_rigs_are_listed(
    both: RigsHarness, path: str
) -> None:
    body = {"calibration": "noise"} if path == "/calibrations" else {"kind": "grip"}
    status, detail = refusal(both.post(path, body))
    assert (status, detail) == (422, "rig is missing: name one of left, right")
    assert refusal(both.post(path, {**body, "rig": "up"})) == (
        404,
        "no rig 'up'; there are left, right",
    )


def test_a_key_finds_the_job_that_it_created_before_the_other_rig_appeared(
    rigs_harness: RigsHarness, files: Files
) -> None:
    key = {"Idempotency-Key": "tray-7"}
    body = {"kind": "grip", "autostart": True}
    first = rigs_harness.call("POST", "/api/v1/jobs", json=body, headers=key)
    rigs_harness.come(files.right)
    rigs_harness.served("right")
    second = rigs_harness.call("POST", "/api/v1/jobs", json=body, headers=key)
    assert (first.status_code, second.status_code) == (201, 200)
    assert first.json()["id"] == second.json()["id"]


def test_a_rig_that_disappears_is_reported_and_does_not_affect_the_other_rig(
    both: RigsHarness,
) -> None:
    both.go("right")
    both.until(lambda: "its programs have stopped" in both.found("right"))
    right = both.get("/rigs/right")
    assert not right["can_start"]
    assert any(reason.startswith("actuator: no program answers") for reason in right["reasons"])
    ready = both.call("GET", "/readyz")
    assert (ready.status_code, ready.json()["status"]) == (200, "ready")
    assert all(reason.startswith("right: ") for reason in ready.json()["reasons"])
    assert both.ended(both.grip(rig="left")["id"])["state"] == "succeeded"
    both.canned["right"].silent.clear()
    both.turn("right", alive=True)
    both.until(lambda: "its programs run again" in both.found("right"))
    assert both.ended(both.grip(rig="right")["id"])["state"] == "succeeded"


def test_another_rig_file_waits_until_no_job_uses_the_rig(both: RigsHarness, files: Files) -> None:
    before, now = files.right.digest(), joined(files.left, "right", force_max_mN=31.0)
    both.at("right")
    job = both.playing_to(IN_HOLD, rig="right")
    playing = both.canned["right"]
    playing.told = now.model_dump_json()
    playing.rig = now
    both.turn("right", alive=True)
    waits = f"its programs run with rig file {now.digest()}, jobs here use {before}"
    both.until(lambda: any(waits in why for why in both.get("/rigs/right")["reasons"]))
    assert both.get("/rigs/right")["digest"] == before
    assert both.get(f"/jobs/{job}")["state"] == "running"
    playing.digests = dict.fromkeys(playing.digests, now.digest())
    playing.pause_at = None
    playing.play()
    assert both.ended(job)["state"] == "succeeded"
    both.until(lambda: both.get("/rigs/right")["digest"] == now.digest())
    both.until(lambda: both.found("right")[-1] == "reloaded with another rig file")
    assert both.names() == ["left", "right"]
    assert both.ended(both.grip(rig="right")["id"])["state"] == "succeeded"


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ('{"rig": {"name": "right", "frills": 3}}', "rig.frills"),
        (None, "served by a supervisor of its own"),
    ],
    ids=["not understood", "not joined"],
)
def test_an_unusable_rig_is_named_with_the_reason(
    rigs_harness: RigsHarness, files: Files, told: str | None, words: str
) -> None:
    alone = files.right.model_copy(update={"bus": files.left.bus})
    made = rigs_harness.make(alone)
    made.told = told or made.told
    rigs_harness.turn("right", alive=True)
    rigs_harness.until(lambda: "right" in rigs_harness.rigs.unusable)
    made.silent.add("actuator")
    assert rigs_harness.names() == ["left"]
    for response in (rigs_harness.call("GET", "/api/v1/rigs/right"), rigs_harness.post("/estop")):
        status, detail = refusal(response)
        assert status == 503
        assert words in detail
    assert rigs_harness.canned["left"].trips  # the other one is stopped nevertheless
    assert any(words in why for why in rigs_harness.call("GET", "/readyz").json()["reasons"])
    rigs_harness.come(files.right)
    rigs_harness.served("right")
    assert rigs_harness.rigs.unusable == {}


def found_and_not_served(harness: RigsHarness, stop: Callable[[str], None], *names: str) -> None:
    """Make rigs known that are not served, each with a call that stops it."""

    def stop_others(rigs: Collection[str], limit_s: float) -> StopOfOthers:
        missed = trip_each(rigs, stop, limit_s)
        return StopOfOthers(set(rigs) - missed.keys(), missed)

    harness.rigs = Rigs(harness.rigs.own, stop_others)
    harness.app = create_app(harness.rigs)
    for name in names:
        harness.rigs.set_unusable(name, "its rig file is not valid")


def test_an_unusable_rig_can_still_be_stopped(rigs_harness: RigsHarness) -> None:
    tripped: list[str] = []
    found_and_not_served(rigs_harness, tripped.append, "right")
    answer = rigs_harness.post("/estop")
    assert answer.status_code == 200
    assert [one["rig"] for one in answer.json()["rigs"]] == ["left", "right"]
    assert rigs_harness.post("/rigs/right/estop").json()["acknowledged"] is True
    assert tripped == ["right", "right"]


def test_unconfirmed_rigs_are_named_with_confirmed_ones(
    rigs_harness: RigsHarness,
) -> None:
    def silent(rig: str) -> None:
        raise BusError(f"no program answers for {rig}")

    found_and_not_served(rigs_harness, silent, "right")
    problem = rigs_harness.post("/estop")
    assert problem.status_code == 503
    assert (problem.json()["stopped"], problem.json()["unconfirmed"]) == (["left"], ["right"])
    assert rigs_harness.post("/rigs/right/estop").status_code == 503
    assert rigs_harness.post("/rigs/none/estop").status_code == 404


def test_rigs_beyond_the_limit_of_one_stop_are_not_reported_as_stopped(
    rigs_harness: RigsHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rigs, "TRIP_S", 0.3)
    over, tried = threading.Event(), list[str]()

    def hang(rig: str) -> None:
        tried.append(rig)
        over.wait(PATIENCE_S)
        raise BusError("it may hang")

    names = [f"found-{number:03}" for number in range(MOST_AT_ONCE + 3)]
    found_and_not_served(rigs_harness, hang, *names)
    problem = rigs_harness.post("/estop")
    over.set()
    assert problem.status_code == 503
    assert {*problem.json()["unconfirmed"]} == {*names}
    assert problem.json()["stopped"] == ["left"]
    assert len(tried) == MOST_AT_ONCE


def test_a_stop_of_the_served_rigs_does_not_wait_for_a_hanging_rig(
    rigs_harness: RigsHarness,
) -> None:
    """This holds however many requests for all rigs wait for one that hangs."""
    over = threading.Event()

    def hang(_rig: str) -> None:
        over.wait(PATIENCE_S)

    found_and_not_served(rigs_harness, hang, "right")
    trips = rigs_harness.canned["left"].trips

    async def stop_many_times() -> list[httpx.Response]:
        transport = httpx.ASGITransport(rigs_harness.app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            every = [asyncio.create_task(client.post("/api/v1/estop")) for _ in range(12)]
            while not trips:
                await asyncio.sleep(0.001)
            trips.clear()
            own = await client.post("/api/v1/rigs/left/estop")
            over_for_others = [task.done() for task in every]
            over.set()
            assert not any(over_for_others)
            assert len(trips) >= 1
            return [own, *await asyncio.gather(*every)]

    own, *every = asyncio.run(stop_many_times())
    assert own.json()["acknowledged"] is True
    assert {one.status_code for one in every} == {200}


class TestTokensWithoutPrograms:
    """Any tool can hold the liveliness tokens of rigs that do not exist."""

    NAMES = tuple(f"ghost-{number:03}" for number in range(150))

    def appear(self, harness: RigsHarness, *, alive: bool = True) -> None:
        for sink in harness.turns:
            for name in self.NAMES:
                for program in LOOP:
                    sink(name, program, alive)

    def test_unusable_rigs_share_one_session_and_few_threads_and_are_queried_less_and_less_often(
        self, rigs_harness: RigsHarness, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(rig_finder, "AGAIN_MOST_S", 1000.0)
        before = threading.active_count()
        self.appear(rigs_harness)
        rigs_harness.until(lambda: {*self.NAMES} <= rigs_harness.rigs.unusable.keys())
        assert threading.active_count() <= before + rig_finder.WORKERS
        (session,) = rigs_harness.opened
        counted = len(session.asked)
        sleep(0.3)  # fifteen times AGAIN_S
        rounds = (len(session.asked) - counted) / len(LOOP) / len(self.NAMES)
        assert rounds < 5.0
        assert len(rigs_harness.opened) == 1

    def test_a_stop_of_all_rigs_is_confirmed_despite_unusable_rigs(
        self, rigs_harness: RigsHarness
    ) -> None:
        self.appear(rigs_harness)
        rigs_harness.until(lambda: {*self.NAMES} <= rigs_harness.rigs.unusable.keys())
        answer = rigs_harness.post("/estop")
        assert answer.status_code == 200
        assert [one["rig"] for one in answer.json()["rigs"]] == ["left"]
        assert len(rigs_harness.opened) == 2
        assert rigs_harness.opened[1].closed
        assert rigs_harness.post(f"/rigs/{self.NAMES[0]}/estop").status_code == 503

    def test_nothing_remains_of_unusable_rigs_once_they_have_disappeared(
        self, rigs_harness: RigsHarness
    ) -> None:
        self.appear(rigs_harness)
        rigs_harness.until(lambda: {*self.NAMES} <= rigs_harness.rigs.unusable.keys())
        self.appear(rigs_harness, alive=False)
        rigs_harness.until(lambda: rigs_harness.rigs.unusable == {})
        session = rigs_harness.opened[0]
        sleep(0.1)
        counted = len(session.asked)
        sleep(0.1)
        assert len(session.asked) == counted


def test_an_emergency_stop_stops_one_rig_or_all(both: RigsHarness) -> None:
    both.post("/rigs/right/estop").raise_for_status()
    assert [len(both.canned[rig].trips) for rig in ("left", "right")] == [0, 1]
    stopped = both.post("/estop").json()["rigs"]
    assert [(one["rig"], one["acknowledged"]) for one in stopped] == [
        ("left", True),
        ("right", True),
    ]
    assert [len(both.canned[rig].trips) for rig in ("left", "right")] == [1, 2]


def test_a_hanging_rig_delays_neither_the_view_nor_the_stop_of_the_other_rig(
    both: RigsHarness,
) -> None:
    with both.canned["right"].turn:  # none of its programs replies
        assert both.get("/rigs/left")["can_start"]
        assert both.post("/rigs/left/estop").json()["acknowledged"]


def test_a_proposal_applies_to_its_own_rig(both: RigsHarness) -> None:
    both.at("right")
    both.bus.edit = lambda ticks: samples.rest(ticks[0].position.epoch)
    job = both.calibrated(rig="right")
    assert job["state"] == "succeeded"
    assert both.get("/calibrations", rig="left")["calibrations"] == []
    (proposal,) = both.get("/calibrations")["calibrations"]
    assert (proposal["id"], proposal["rig"]) == (job["id"], "right")
    both.freed(job["id"])
    both.post(f"/calibrations/{job['id']}/actions", {"type": "accept"}).raise_for_status()
    versions = {rig: both.get(f"/rigs/{rig}")["model"]["version"] for rig in ("left", "right")}
    assert versions == {"left": 0, "right": 1}


def test_a_trajectory_belongs_to_the_rig_it_was_planned_for(both: RigsHarness) -> None:
    made = both.post("/trajectories", {"kind": "grip", "rig": "right"}).json()
    assert both.get(f"/trajectories/{made['digest']}")["stale"] == []
    started = both.post(f"/trajectories/{made['digest']}/jobs", {"autostart": True}).json()
    assert started["rig"] == "right"
    assert both.ended(started["id"])["state"] == "succeeded"


def test_the_page_shows_its_own_rig_unless_another_is_named(both: RigsHarness) -> None:
    assert 'data-rig="left"' in both.call("GET", "/").text
    assert 'data-rig="right"' in both.call("GET", "/?rig=right").text
    assert both.call("GET", "/?rig=up").status_code == 404
    assert 'data-rig="right"' in both.call("GET", "/?%72ig=r%69ght").text
    # The scripts take the name from the page, so that no other reading of the address counts.
    for repeated in ("rig=left&rig=right", "rig=right&rig=right", "rig=left&%72ig=right"):
        assert both.call("GET", f"/?{repeated}").status_code == 422
