"""A series: many jobs by one request, its stop rules, its actions, and its state after a
restart."""

from collections.abc import Callable
from typing import Any

import pytest

from pincette.api.series import SERIES_STATES, TARGETS, SeriesRequest
from pincette.config import RigFile
from pincette.control.record import replace
from pincette.core.faults import Outcome
from pincette_supervisor.jobs.series_jobs import requests_of
from pincette_supervisor.journal.store import utc_now
from pincette_supervisor.problems import ProblemError

from .canned import IN_APPROACH, IN_HOLD
from .harness import Harness
from .samples import Tick

GRIP = {"kind": "grip", "hold_s": 0.5}
BEADS = [{"sample": f"B{number}", "force_mN": force} for number, force in ((1, 8.0), (2, 12.0))]
Edit = Callable[[list[Tick]], list[Tick]]


def failing(*numbers: int) -> Edit:
    """Let the grips of these numbers, from 1, meet no part."""
    played = [0]

    def edit(ticks: list[Tick]) -> list[Tick]:
        played[0] += 1
        if played[0] not in numbers:
            return ticks
        return [
            tick
            if tick.telemetry.outcome is Outcome.NONE
            else replace(tick, telemetry=replace(tick.telemetry, outcome=Outcome.NO_CONTACT))
            for tick in ticks
        ]

    return edit


def begun(harness: Harness, **members: Any) -> dict[str, Any]:
    response = harness.post("/series", {"job": GRIP, **members})
    assert response.status_code == 201, response.text
    return response.json()


def over(harness: Harness, series: str) -> dict[str, Any]:
    return harness.get(f"/series/{series}", wait="over", timeout_s=30)


def acted(harness: Harness, series: str, action: str, status: int = 202) -> dict[str, Any]:
    response = harness.post(f"/series/{series}/actions", {"type": action})
    assert response.status_code == status, response.text
    return response.json()


def numbers(series: dict[str, Any]) -> list[tuple[int, str | None]]:
    return [(one["number"], one["state"]) for one in series["jobs"]]


def test_all_jobs_of_a_series_run_in_their_order(harness: Harness) -> None:
    made = begun(harness, values=BEADS, name="beads", repeats=2)
    assert (made["state"], made["total"], made["ended"]) == ("running", 4, 0)
    assert made["remaining_s"] > 0.0
    found = over(harness, made["id"])
    assert (found["state"], found["ended"], found["failed"]) == ("completed", 4, 0), found
    assert found["remaining_s"] == 0.0
    assert found["allowed_actions"] == []
    assert found["ended_at"] is not None
    assert [one["request"]["sample"] for one in found["jobs"]] == ["B1", "B2", "B1", "B2"]
    jobs = harness.get("/jobs", label=f"series={made['id']}")["jobs"]
    assert [job["id"] for job in jobs[::-1]] == [one["job"] for one in found["jobs"]]
    assert [job["labels"]["series_job"] for job in jobs[::-1]] == ["1", "2", "3", "4"]
    assert [job["values"]["force_mN"] for job in jobs[::-1]] == [8.0, 12.0, 8.0, 12.0]
    events = harness.told("series")
    assert [event.body["number"] for event in events if event.body["number"]] == [1, 2, 3, 4]
    assert events[-1].body["state"] == "completed"
    table = harness.call("GET", f"/api/v1/jobs/export.csv?label=series={made['id']}").text
    assert table.count("\n") == 5
    (listed,) = harness.get("/series")["series"]
    assert listed == {name: found[name] for name in listed}


def planned(harness: Harness, **members: Any) -> list[dict[str, Any]]:
    response = harness.post("/series", {"job": GRIP, "dry_run": True, **members})
    assert response.status_code == 200, response.text
    plan = response.json()
    assert plan["total"] == len(plan["jobs"])
    assert harness.get("/series")["series"] == []
    assert harness.bus.ticks == []
    return [one["request"] for one in plan["jobs"]]


def test_a_series_over_a_grid_has_a_job_for_each_combination(harness: Harness) -> None:
    grid = {"force_mN": [8.0, 12.0], "sample": ["B1", "B2", "B3"]}
    found = [(one["force_mN"], one["sample"]) for one in planned(harness, grid=grid)]
    assert found == [(force, sample) for force in grid["force_mN"] for sample in grid["sample"]]


def test_a_seed_shuffles_all_jobs_the_same_way_each_time(harness: Harness) -> None:
    grid = {"sample": [f"B{number}" for number in range(6)]}

    def order(seed: int | None) -> list[str]:
        jobs = planned(harness, grid=grid, repeats=2, shuffle_seed=seed)
        return [one["sample"] for one in jobs]

    assert order(7) == order(7)
    assert order(7) != order(None)
    assert order(7) != order(8)
    assert sorted(order(7)) == sorted(order(None))


@pytest.mark.parametrize(
    "table",
    [
        "sample,force_mN,retries,label.lot,zero_confirmed\nB1,8.5,2,7,true\n",
        "\ufeffsample;force_mN;retries;label.lot;zero_confirmed\n# lot 7\nB1;8,5;2;7;true",
    ],
)
def test_a_table_gives_the_members_of_each_job(harness: Harness, table: str) -> None:
    (found,) = planned(harness, csv=table)
    assert found == {
        **GRIP,
        "sample": "B1",
        "force_mN": 8.5,
        "retries": 2,
        "zero_confirmed": True,
        "labels": {"lot": "7"},
    }


def test_quoted_cells_of_a_table_are_read_exactly(harness: Harness) -> None:
    """Line breaks, quotes and separators in a quoted cell, and labels beside ``label.`` columns."""
    table = (
        "sample;notes;label.Träger;labels\r\n"
        '# comment\r\n"Körner; ""groß""";"two\nlines";4;"{""lot"": ""7""}"\r\nB\u20282;;5;\r\n'
    )
    first, second = planned(harness, csv=table)
    assert first == {
        **GRIP,
        "sample": 'Körner; "groß"',
        "notes": "two\nlines",
        "labels": {"lot": "7", "Träger": "4"},
    }
    assert second == {**GRIP, "sample": "B\u20282", "labels": {"Träger": "5"}}


REFUSED: list[tuple[dict[str, Any], str, str]] = [
        ({"values": [{}], "grid": {"force_mN": [1.0]}}, "", "values and grid exclude each other"),
        ({"values": [{"force_mN": 8.0}, {"force_mN": -1.0}]}, "/values/1/force_mN",
         "job 2: force_mN = -1.0 mN: must be above 0 mN"),
        ({"values": [{"force": 8.0}]}, "/values/0/force", "did you mean force_mN?"),
        ({"grid": {"force_mN": [8.0, "x"]}}, "/grid/force_mN", "job 2: force_mN = 'x' mN"),
        ({"job": {"kind": "grib"}}, "/job/kind", "job 1: kind = 'grib'"),
        ({"job": {**GRIP, "queue": True}}, "/job/queue", "leave it out of the job"),
        ({"csv": "force_mN\n"}, "/csv", "one line for each job"),
        ({"csv": "force_mN,sample\n8\n"}, "/csv", "line 2: 1 cells, must be 2"),
        ({"csv": "force_mN\n8\nB\n"}, "/csv", "line 3: force_mN = 'B' mN: give digits"),
        ({"csv": "force_mN,force_mN\n8,9\n"}, "/csv", "'force_mN' has no name of its own"),
        ({"csv": f"sample\n{'x' * 140_000}\n"}, "/csv", "line 2: "),
        ({"csv": 'sample,notes\nA,"b\nC,d\n'}, "/csv", "line 2: "),
        ({"csv": f"points\n{'[' * 20_000}\n"}, "/csv", "line 2: points = '[["),
        ({"csv": "labels,label.a\nx,y\n"}, "/csv", "labels = 'x': must be an object"),
        ({"job": {**GRIP, "labels": None}}, "/job/labels", "must be an object"),
        ({"job": {**GRIP, "labels": 3}, "csv": "label.a\ny\n"}, "/csv", "must be an object"),
        ({"values": [{"labels": "x"}]}, "/values/0/labels", "must be an object"),
        ({"values": BEADS, "repeats": 501}, "/repeats", "are 1002 jobs: a series has 1000"),
        ({"grid": {"sample": ["a"] * 40, "notes": ["a"] * 40}}, "/grid", "1600 combinations"),
        ({"stop_after_failures": 0}, "/stop_after_failures", "must be 1 or more"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("members", "pointer", "words"),
    REFUSED,
)
def test_an_unusable_request_is_refused_with_a_readable_message(
    harness: Harness, members: dict[str, Any], pointer: str, words: str
) -> None:
    refused = harness.post("/series", {"job": GRIP, **members})
    assert refused.status_code == 422, refused.text
    problem = refused.json()
    assert problem["errors"][0]["pointer"] == pointer
    assert words in problem["detail"]
    assert harness.get("/series")["series"] == []
    assert harness.get("/jobs")["jobs"] == []


@pytest.mark.parametrize(
    ("table", "named"),
    [
        ("force_N;sample\n0,008;A\n", "force_N"),
        ("Force_mN;sample\n8;A\n", "Force_mN"),
        ("force_mN [N];sample\n8;A\n", "force_mN [N]"),
        ("hold_ms;force_mN\n1000;8\n", "hold_ms"),
        ("t_s;force_mN\n0;8\n", "t_s"),
        ("8;A\n9;B\n", "8"),
        ("#force_mN;sample\n8;A\n9;B\n", "8"),
        ("force_mN sample\n8 A\n", "force_mN sample"),
        ("force_mN,sample\n8,5,A\n", "line 2"),
        ("force_mN;sample\nnan;A\n", "line 2"),
        ("force_mN;sample\n1,000;A\n", "line 2"),
        ("hold_s;force_mN\n1 000;8\n", "line 2"),
        ("retries;force_mN\n2,5;8\n", "retries"),
        ("zero_confirmed;force_mN\n2;8\n", "zero_confirmed"),
        ("label.a;label.a;force_mN\n1;2;8\n", "label.a"),
        ("PAR1\x15\x04;\n2;\n", "line 1"),
    ],
)
def test_a_table_with_other_columns_or_values_is_refused(table: str, named: str) -> None:
    with pytest.raises(ProblemError) as refused:
        requests_of(SeriesRequest(job=GRIP, csv=table))
    assert refused.value.status == 422
    assert named in refused.value.detail


def test_nothing_moves_if_one_job_would_break_a_limit(harness: Harness) -> None:
    refused = harness.post("/series", {"job": GRIP, "values": [{}, {"force_mN": 500.0}]})
    problem = refused.json()
    assert (refused.status_code, problem["type"].rpartition(":")[2]) == (422, "limit-violation")
    assert problem["detail"].startswith("job 2: ")
    assert problem["violations"][0]["limit"] == 40.0
    assert harness.get("/jobs")["jobs"] == []


@pytest.mark.parametrize(
    ("most", "state", "ran"), [(1, "stopped", 2), (2, "stopped", 3), (3, "completed", 4),
                               (None, "completed", 4)]
)  # fmt: skip
def test_a_series_stops_after_the_configured_number_of_failures(
    harness: Harness, most: int | None, state: str, ran: int
) -> None:
    harness.bus.edit = failing(2, 3)
    made = begun(harness, repeats=4, stop_after_failures=most)
    found = over(harness, made["id"])
    assert (found["state"], found["ended"]) == (state, ran), found["cause"]
    states = ["succeeded", "failed", "failed", "succeeded"][:ran] + [None] * (4 - ran)
    assert [one["state"] for one in found["jobs"]] == states
    if state == "completed":
        return
    assert found["jobs"][ran - 1]["job"] in found["cause"]
    assert found["allowed_actions"] == ["resume"]
    harness.bus.edit = list
    acted(harness, made["id"], "resume")
    found = over(harness, made["id"])
    assert (found["state"], found["ended"], found["failed"]) == ("completed", 4, ran - 1)


def test_a_paused_series_lets_its_job_end_and_starts_no_other(harness: Harness) -> None:
    harness.bus.pause_at = IN_HOLD
    made = begun(harness, repeats=2)
    harness.until(lambda: harness.manager.active is not None)
    harness.reach(harness.live.id, "running")
    paused = acted(harness, made["id"], "pause")
    assert (paused["state"], paused["allowed_actions"]) == ("paused", ["resume", "stop"])
    assert acted(harness, made["id"], "pause", 200)["state"] == "paused"
    harness.bus.pause_at = None
    harness.bus.play()
    first = paused["job"]
    assert harness.freed(first)["state"] == "succeeded"
    assert harness.get(f"/series/{made['id']}")["ended"] == 1
    assert harness.manager.active is None
    acted(harness, made["id"], "resume")
    assert over(harness, made["id"])["state"] == "completed"


def test_a_stopped_series_stops_its_job_and_keeps_the_part(harness: Harness) -> None:
    harness.bus.pause_at = IN_HOLD
    made = begun(harness, repeats=3)
    harness.until(lambda: harness.manager.active is not None)
    harness.reach(harness.live.id, "running")
    harness.until(lambda: harness.live.status.held)
    stopped = acted(harness, made["id"], "stop")
    assert stopped["state"] == "stopped"
    assert harness.ended(stopped["job"])["state"] == "stopped"
    assert harness.get("/rigs/demo")["part"] == "held"
    assert acted(harness, made["id"], "resume", 409)["type"].endswith("part-held")
    harness.bus.pause_at = None
    harness.acted(stopped["job"], "release")
    harness.freed(stopped["job"])
    acted(harness, made["id"], "resume")
    found = over(harness, made["id"])
    assert numbers(found) == [(1, "stopped"), (2, "succeeded"), (3, "succeeded")]


@pytest.mark.parametrize("how", ["stop", "estop"])
def test_a_person_who_stops_a_job_pauses_its_series(harness: Harness, how: str) -> None:
    harness.bus.pause_at = IN_APPROACH
    made = begun(harness, repeats=2, stop_after_failures=None)
    harness.until(lambda: harness.manager.active is not None)
    job = harness.live.id
    harness.reach(job, "running")
    if how == "stop":
        harness.acted(job, "stop")
    else:
        assert harness.post("/rigs/demo/estop").status_code == 200
    harness.bus.pause_at = None
    found = over(harness, made["id"])
    assert (found["state"], found["ended"]) == ("paused", 1), found
    assert found["cause"]
    if how == "estop":
        assert harness.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
    acted(harness, made["id"], "resume")
    assert over(harness, made["id"])["state"] == "completed"


@pytest.mark.parametrize("after_restart", ["wait", "continue"])
def test_a_restarted_supervisor_repeats_the_interrupted_job(
    harness: Harness, rig_file: RigFile, open_harness: Callable[..., Harness], after_restart: str
) -> None:
    made = begun(harness, repeats=3, after_restart=after_restart)
    harness.until(lambda: harness.get(f"/series/{made['id']}")["ended"] >= 1)
    harness.bus.pause_at = IN_APPROACH
    harness.until(lambda: harness.bus.place == IN_APPROACH)
    before = harness.get(f"/series/{made['id']}")
    harness.manager.close()
    after = open_harness(rig_file)
    after.bus.latch = ""  # the actuator was not switched off
    after.health.refresh()
    after.manager.recover(after.store.interrupt_unfinished(utc_now()))
    if after_restart == "wait":
        found = after.get(f"/series/{made['id']}")
        assert (found["state"], found["cause"]) == ("paused", "the supervisor was restarted")
        acted(after, made["id"], "resume")
    found = over(after, made["id"])
    assert found["cause"] == ""
    assert (found["state"], found["failed"], found["ended"]) == ("completed", 0, 3)
    jobs = after.get("/jobs", label=f"series={made['id']}")["jobs"]
    assert [job["state"] for job in jobs].count("interrupted") == 1
    assert len(jobs) == 4
    done = [one["job"] for one in before["jobs"] if one["state"] == "succeeded"]
    assert [one["job"] for one in found["jobs"]][: len(done)] == done


def test_a_key_creates_one_series_and_only_one_series_runs_at_a_time(harness: Harness) -> None:
    harness.bus.pause_at = IN_APPROACH
    body = {"job": GRIP, "repeats": 2}

    def sent(key: str, **members: Any) -> Any:
        headers = {"Idempotency-Key": key}
        return harness.call("POST", "/api/v1/series", json={**body, **members}, headers=headers)

    first, again = sent("lot 7"), sent("lot 7")
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.json()["id"] == again.json()["id"]
    assert again.headers["Idempotency-Replayed"] == "true"
    reused, second = sent("lot 7", repeats=3), sent("lot 8")
    assert reused.json()["type"].endswith("idempotency-key-reused")
    assert (second.status_code, second.json()["series"]) == (409, first.json()["id"])
    harness.until(lambda: harness.manager.active is not None)
    acted(harness, first.json()["id"], "stop")
    assert over(harness, first.json()["id"])["state"] == "stopped"
    assert sent("lot 8").status_code in (201, 503)


def test_a_claim_of_another_caller_pauses_a_series(harness: Harness) -> None:
    harness.bus.pause_at = IN_APPROACH
    made = begun(harness, repeats=2)
    harness.until(lambda: harness.manager.active is not None)
    harness.reach(harness.live.id, "running")
    claim = {"X-Claim": "the-secret-of-another"}
    taken = harness.call("PUT", "/api/v1/rigs/demo/claim", json={"lease_s": 60}, headers=claim)
    assert taken.status_code == 200, taken.text
    harness.bus.pause_at = None
    harness.bus.play()
    found = over(harness, made["id"])
    assert (found["state"], found["ended"]) == ("paused", 1)
    assert "claimed by" in found["cause"]
    assert harness.post(f"/series/{made['id']}/actions", {"type": "resume"}).status_code == 409


@pytest.mark.usefixtures("drawn")
def test_the_report_has_the_figure_and_the_verdict_of_each_job(harness: Harness) -> None:
    harness.bus.edit = failing(2)
    made = begun(harness, values=BEADS, name="<lot> 7", stop_after_failures=None)
    over(harness, made["id"])
    page = harness.call("GET", f"/api/v1/series/{made['id']}/report")
    assert page.status_code == 200, page.text
    assert "&lt;lot&gt; 7" in page.text
    assert "no contact" in page.text
    assert "<th>release</th><th>tries</th>" in page.text
    assert page.headers["content-disposition"].startswith("attachment")
    plot = harness.call("GET", f"/api/v1/series/{made['id']}/plot")
    assert plot.content.startswith(b"\x89PNG")


def test_a_request_for_an_unknown_series_is_answered_with_404(harness: Harness) -> None:
    for path in ("", "/report", "/plot"):
        assert harness.call("GET", f"/api/v1/series/none{path}").status_code == 404
    assert harness.post("/series/none/actions", {"type": "stop"}).status_code == 404
    assert harness.call("GET", "/api/v1/series?before=none").status_code == 404


def test_every_action_of_a_series_leads_to_the_state_in_the_table() -> None:
    for state, row in SERIES_STATES.items():
        for action, target in row.actions.items():
            assert TARGETS[action] == target
            assert target != state
        assert row.over == (state != "running")
