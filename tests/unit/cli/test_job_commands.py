"""Every command that calls a supervisor: its request, its output, its exit status."""

import json
from datetime import datetime
from pathlib import Path
from typing import Any

import httpx
import pytest

from pincette.api.calibrations import Proposal
from pincette.api.events import Event
from pincette.api.jobs import Action, Artifact, Job
from pincette.api.plans import Plan
from pincette.api.requests import Recipe, RecipeHistory
from pincette.api.rigs import Rig
from pincette.api.series import Series, SeriesJob
from pincette.cli import MEANINGS, Exit
from pincette.cli.main import main
from tests.unit.client import desk
from tests.unit.client.desk import Desk

from .conftest import At

NAME = desk.example(Job)["id"]
AT = ("--rig-name", "demo")
PROPOSED = (("first", "other"), ("second", "demo"), ("third", "demo"))
RESULT: dict[str, Any] = {
    "outcome": "moved",
    "phases": [],
    "calibration": "noise",
    "values": [],
    "figures": [],
    "statement": "",
    "warnings": [],
}
SUCCEEDED = {"kind": "calibrate", "state": "succeeded", "result": RESULT}


def sent(supervisor: Desk, place: int = -1) -> Any:
    return json.loads(supervisor.asked[place].content)


def test_with_json_output_a_followed_job_prints_only_json(
    at: At, capsys: pytest.CaptureFixture[str]
) -> None:
    supervisor = at(desk.job(kind="calibrate", state="running"), desk.job(**SUCCEEDED))
    assert main(["job", "calibrate", "noise", "--json", *AT]) == Exit.DONE
    output = capsys.readouterr()
    assert json.loads(output.out)["state"] == "succeeded"
    assert "succeeded" in output.err
    assert sent(supervisor, 0) == {
        "kind": "calibrate",
        "calibration": "noise",
        "rig": "demo",
        "autostart": True,
    }


def test_a_series_is_followed_while_the_supervisor_restarts(
    at: At, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text('[job]\nkind = "grip"\n', encoding="utf-8")
    one = desk.example(SeriesJob, job=NAME, state="succeeded")
    ended = {"state": "completed", "total": 1, "ended": 1, "failed": 0, "remaining_s": None}
    gone = httpx.ConnectError("refused")
    supervisor = at(
        httpx.Response(200, json={"rigs": [desk.example(Rig)]}),
        httpx.Response(200, json=desk.example(Series, jobs=[one], **ended)),
        gone,
        desk.job(state="succeeded"),
        gone,
        desk.job(state="succeeded"),
    )
    assert main(["series", "run", str(plan)]) == Exit.DONE
    assert NAME in capsys.readouterr().out
    assert len(supervisor.slept_s) == 2


@pytest.mark.parametrize(
    ("answer", "status", "words"),
    [
        (desk.problem(422, "limit-violation"), Exit.LIMIT, "Title: detail"),
        (desk.problem(409, "estop-engaged"), Exit.NOT_READY, "Title: detail"),
        (desk.problem(409, "rig-latched"), Exit.NOT_READY, "Title: detail"),
        (desk.problem(503, "rig-not-ready", reasons=["no sensor"]), Exit.NOT_READY, "no sensor"),
        (desk.problem(409, "job-active"), Exit.FAILED, "Title: detail"),
        (desk.problem(422, "invalid-request"), Exit.FAILED, "Title: detail"),
        (httpx.ConnectError("refused"), Exit.NO_ANSWER, "no supervisor answers at http://127"),
        (httpx.ConnectError("refused"), Exit.NO_ANSWER, "\n  remedy: `pincette up` starts"),
        (desk.job(state="failed", cause="lost"), Exit.FAILED, ""),
    ],
)
def test_a_job_that_does_not_start_has_the_documented_exit_status(
    at: At, capsys: pytest.CaptureFixture[str], answer: Any, status: Exit, words: str
) -> None:
    at(answer)
    assert main(["job", "grip", *AT]) == status
    assert words in capsys.readouterr().err


def test_a_long_plan_is_not_reported_as_a_missing_supervisor(
    at: At, capsys: pytest.CaptureFixture[str]
) -> None:
    supervisor = at(httpx.ReadTimeout("timed out"))
    assert main(["plan", "track", "--gains", "tuned", *AT]) == Exit.NO_ANSWER
    output = capsys.readouterr().err
    assert "no reply came in time from http://127" in output
    assert "\n  remedy: try again: the supervisor may be busy" in output
    assert "no supervisor answers" not in output
    assert supervisor.asked[0].extensions["timeout"]["read"] >= 180.0
    assert supervisor.asked[0].extensions["timeout"]["connect"] <= 10.0


def test_with_json_output_a_refusal_is_printed_as_its_problem_document(
    at: At, capsys: pytest.CaptureFixture[str]
) -> None:
    at(desk.problem(422, "limit-violation", violations=[{"message": "too strong"}]))
    assert main(["job", "grip", "--json", *AT]) == Exit.LIMIT
    output = capsys.readouterr()
    assert json.loads(output.out)["violations"] == [{"message": "too strong"}]
    assert "too strong" in output.err


def test_ctrl_c_does_not_affect_the_job(at: At, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(_request: httpx.Request) -> httpx.Response:
        raise KeyboardInterrupt

    supervisor = at(desk.job(), interrupted)
    assert main(["job", "grip", *AT]) == Exit.INTERRUPTED
    assert f"job {NAME} continues: `pincette job stop {NAME}`" in capsys.readouterr().err
    assert supervisor.paths() == ["POST /api/v1/jobs", f"GET /api/v1/jobs/{NAME}"]


def test_a_job_runs_without_being_followed(at: At, capsys: pytest.CaptureFixture[str]) -> None:
    at(desk.job())
    assert main(["job", "grip", "--no-wait", *AT]) == Exit.DONE
    assert capsys.readouterr().out == f"{NAME}\n"


def test_the_command_line_prints_the_progress_of_a_job(at: At) -> None:
    supervisor = at(desk.job(), desk.job(), desk.job())
    words = "--queue --recipe bead@2 --label part=b12 --label tray=7 --on-stop release"
    main(["job", "grip", "--until-released", "--no-wait", *words.split(), *AT])
    assert sent(supervisor) == {
        "kind": "grip",
        "rig": "demo",
        "autostart": True,
        "until_released": True,
        "queue": True,
        "recipe": "bead@2",
        "labels": {"part": "b12", "tray": "7"},
        "on_stop": "release",
    }
    main(["job", "move", "--by-um", "-2", "--no-zero", "--teach", "home", "--no-wait", *AT])
    values = {"by_um": -2.0, "zero": False, "teach": "home"}
    assert sent(supervisor) == {"kind": "move", "rig": "demo", "autostart": True, **values}
    main(["job", "release", "--release-s", "2", "--no-wait", *AT])
    assert sent(supervisor)["kind"] == "release"


@pytest.mark.parametrize(
    "action", ["pause", "resume", "stop", "abort", "release", "continue", "start"]
)
def test_an_action_is_sent(at: At, capsys: pytest.CaptureFixture[str], action: str) -> None:
    supervisor = at(desk.job(), desk.job(state="pausing"))
    assert main(["job", action, NAME]) == Exit.DONE
    assert sent(supervisor) == {"type": action}
    assert capsys.readouterr().out == f"job {NAME}: {action} accepted; it is pausing\n"


@pytest.mark.parametrize("decision", ["retry", "accept", "give_up"])
def test_a_decision_on_a_job_that_waits_is_sent(at: At, decision: str) -> None:
    supervisor = at(desk.job(), desk.job(state="failed"))
    assert main(["job", decision.replace("_", "-"), NAME]) == Exit.DONE
    assert sent(supervisor) == {"type": decision}


def test_a_retry_at_another_place_states_the_place(at: At) -> None:
    supervisor = at(desk.job(), desk.job(state="failed"))
    words = ["--x-um", "6.2", "--u-um", "0.5", "--source", "camera-1"]
    assert main(["job", "retry-at", NAME, *words]) == Exit.DONE
    request = sent(supervisor)
    assert request["type"] == "retry_at"
    measured_at = datetime.fromisoformat(request["place"].pop("measured_at"))
    assert measured_at.tzinfo is not None
    assert request["place"] == {"x_um": 6.2, "u_um": 0.5, "source": "camera-1"}


def test_the_last_job_needs_no_id(at: At) -> None:
    jobs = httpx.Response(200, json={"jobs": [desk.example(Job)]})
    supervisor = at(jobs, desk.job())
    assert main(["job", "pause", "last", *AT]) == Exit.DONE
    assert supervisor.paths()[-1] == f"POST /api/v1/jobs/{NAME}/actions"
    at(httpx.Response(200, json={"jobs": []}))
    assert main(["job", "pause", "last", *AT]) == Exit.FAILED


def test_the_last_calibration_needs_no_id(at: At) -> None:
    proposals = [desk.example(Proposal) | {"id": name, "rig": rig} for name, rig in PROPOSED]
    listed = httpx.Response(200, json={"calibrations": proposals})
    supervisor = at(listed, httpx.Response(200, json=proposals[1]))
    assert main(["model", "accept", "last", *AT]) == Exit.DONE
    assert supervisor.paths()[-1] == "POST /api/v1/calibrations/second/actions"
    at(httpx.Response(200, json={"calibrations": proposals[:1]}))
    assert main(["model", "accept", "last", *AT]) == Exit.FAILED


def test_stop_waits_until_the_rig_has_confirmed(at: At, capsys: pytest.CaptureFixture[str]) -> None:
    stopped = desk.job(state="stopped", allowed_actions=["release", "abort"])
    supervisor = at(desk.rig(active_job=NAME), desk.job(), desk.job(state="stopping"), stopped)
    assert main(["stop", *AT]) == Exit.DONE
    assert supervisor.paths()[-1] == f"GET /api/v1/jobs/{NAME}"
    output = capsys.readouterr().out
    assert f"job {NAME} is stopped" in output
    assert f"`pincette job release {NAME}` releases it" in output
    at(desk.rig(active_job=None))
    assert main(["stop", *AT]) == Exit.DONE
    assert capsys.readouterr().out == "no job runs\n"


def test_a_plan_is_drawn(at: At, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = httpx.Response(200, json=desk.example(Plan, feasible=False))
    supervisor = at(plan, httpx.Response(200, content=b"\x89PNG"))
    picture = tmp_path / "plan.png"
    assert main(["plan", "grip", "--force-mN", "9", "--plot", str(picture), *AT]) == Exit.LIMIT
    assert picture.read_bytes() == b"\x89PNG"
    assert supervisor.paths() == ["POST /api/v1/jobs", "POST /api/v1/trajectories/plot"]
    assert sent(supervisor) == {"kind": "grip", "rig": "demo", "force_mN": 9.0}
    assert f"plot: {picture}" in capsys.readouterr().out


def test_jobs_are_listed_and_shown(at: At, capsys: pytest.CaptureFixture[str]) -> None:
    action = desk.example(Action)
    one = desk.example(Job, actions=[action], labels={"part": "b12"}, result={**RESULT})
    supervisor = at(
        httpx.Response(200, json={"jobs": [one]}),
        httpx.Response(200, json=one),
        httpx.Response(200, json={"jobs": []}),
    )
    assert main(["job", "list", "--state", "running", *AT]) == Exit.DONE
    assert dict(supervisor.asked[0].url.params) == {
        "limit": "20",
        "rig": "demo",
        "state": "running",
    }
    assert NAME in capsys.readouterr().out
    assert main(["job", "show", NAME]) == Exit.DONE
    output = capsys.readouterr().out
    assert "part: b12" in output
    assert "release by 127.0.0.1, took effect at sample 462" in output
    assert "allowed actions: pause, stop, abort, release" in output
    assert main(["job", "list", "--json", *AT]) == Exit.DONE
    assert json.loads(capsys.readouterr().out) == []


def test_a_record_is_downloaded(at: At, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = {"artifacts": [desk.example(Artifact, name="result.json", sha256="")]}
    files["artifacts"][0]["sha256"] = (
        "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a"
    )
    listed = httpx.Response(200, json=files)
    content = httpx.Response(200, content=b"{}")
    supervisor = at(desk.job(), listed, listed, content)
    out = tmp_path / "got"
    assert main(["records", "get", NAME, "--out", str(out)]) == Exit.DONE
    assert (out / "result.json").read_bytes() == b"{}"
    assert capsys.readouterr().out == f"{out / 'result.json'}\n"
    text = httpx.Response(200, content=b"t_s\n")
    for words, names in (
        (["samples.csv"], ["samples.csv"]),
        (["--spreadsheet", "tab"], ["samples.csv"]),
        (["--numbers"], ["numbers.csv", "numbers.csv-metadata.json"]),
        (["snapshot.mcap"], ["snapshot.mcap"]),
    ):
        supervisor = at(desk.job(), *[listed, text] * len(names))
        assert main(["records", "get", NAME, *words, "--out", str(out)]) == Exit.DONE
        paths = [path for path in supervisor.paths() if "/artifacts/" in path]
        assert [path.rpartition("/")[2] for path in paths] == names
        assert {one.name for one in out.iterdir()} >= {*names}
    for words in (["--numbers", "--spreadsheet", "tab"], ["samples.csv", "--numbers"]):
        assert main(["records", "get", NAME, *words]) == Exit.USAGE


def test_the_download_of_a_job_without_a_record_fails(at: At, tmp_path: Path) -> None:
    at(desk.job(), httpx.Response(200, json={"artifacts": []}))
    assert main(["records", "get", NAME, "--out", str(tmp_path / "got")]) == Exit.FAILED
    assert not (tmp_path / "got").exists()


def test_jobs_are_exported_as_numbers(at: At, tmp_path: Path) -> None:
    out = tmp_path / "wafer.csv"
    at(httpx.Response(200, content=b"id\n1\n"), httpx.Response(200, json={"url": "export.csv"}))
    assert main(["job", "list", "--numbers", "--out", str(out)]) == Exit.DONE
    assert out.read_bytes() == b"id\n1\n"
    assert json.loads((tmp_path / "wafer.csv-metadata.json").read_bytes()) == {"url": "wafer.csv"}
    words = ["--numbers", "--spreadsheet", "tab"]
    assert main(["job", "list", "--out", str(out), *words]) == Exit.USAGE
    assert main(["job", "list", "--out", str(tmp_path / "a.parquet"), "--numbers"]) == Exit.USAGE
    at()
    assert main(["job", "list", "--numbers"]) == Exit.USAGE


def test_a_recipe_is_saved(at: At, capsys: pytest.CaptureFixture[str]) -> None:
    supervisor = at(httpx.Response(201, json=desk.example(Recipe)))
    words = ["force_mN=8", "part.stiffness_mN_per_um=2.1", "scheme=dsmifc"]
    assert main(["recipe", "save", "bead-1mm", *words, "--note", "glass"]) == Exit.DONE
    values = {"force_mN": 8, "part": {"stiffness_mN_per_um": 2.1}, "scheme": "dsmifc"}
    assert sent(supervisor) == {"name": "bead-1mm", "values": values, "note": "glass"}
    assert "bead-1mm@3 saved" in capsys.readouterr().out
    history = desk.example(RecipeHistory, versions=[desk.example(Recipe)])
    at(*[httpx.Response(200, json=history)] * 2)
    assert main(["recipe", "show", "bead-1mm"]) == Exit.DONE
    assert "force_mN = 8.0" in capsys.readouterr().out
    assert main(["recipe", "show", "bead-1mm@9"]) == Exit.FAILED
    assert "there are 3" in capsys.readouterr().err


def test_a_halted_queue_states_why_and_how_to_continue(
    at: At, capsys: pytest.CaptureFixture[str]
) -> None:
    halted = {"length": 1, "halted": "job x failed: lost", "capacity": 16}
    waiting = desk.example(Job, state="queued", position=1)
    supervisor = at(
        desk.rig(queue=halted), httpx.Response(200, json={"jobs": [waiting]}), desk.rig()
    )
    assert main(["rigs", "demo"]) == Exit.DONE
    output = capsys.readouterr().out
    assert "halted: job x failed: lost" in output
    assert NAME in output
    assert main(["queue", "resume", *AT]) == Exit.DONE
    assert sent(supervisor) == {"type": "resume"}
    assert capsys.readouterr().out == "no job waits\n"


def test_a_watched_rig_prints_one_line_per_event(
    at: At, capsys: pytest.CaptureFixture[str]
) -> None:
    events = [
        desk.example(Event, number=1, body={"state": "running", "cause": ""}),
        desk.example(Event, number=None, kind="progress", body={"percent": 3}),
        desk.example(Event, number=2, kind="alarm", body={"cause": "estop", "value_mN": 1.5}),
    ]

    def over(_request: httpx.Request) -> httpx.Response:
        raise KeyboardInterrupt

    at(desk.rig(), desk.stream(*events), over)
    assert main(["watch", "--after", "0", *AT]) == Exit.INTERRUPTED
    shown = capsys.readouterr()
    assert shown.err.startswith("demo: idle; ")
    assert "events are printed as they happen" in shown.err
    lines = shown.out.splitlines()
    assert [line.split("  ", 1)[1] for line in lines] == [
        f"{NAME}  state    running",
        f"{NAME}  alarm    estop, value_mN 1.5",
    ]
    at(desk.rig(), desk.stream(*events, broken=True), httpx.ConnectError(""), over)
    assert main(["watch", "--json", "--after", "0", *AT]) == Exit.INTERRUPTED
    output = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [one["kind"] for one in output] == ["state", "progress", "alarm"]


def test_reset_reports_the_cause(at: At, capsys: pytest.CaptureFixture[str]) -> None:
    latch = {"state": "latched", "cause": "estop", "clear": ""}
    stopped = {"rig": "demo", "cause": "estop", "acknowledged": True, "detail": ""}
    at(
        httpx.Response(200, json={"rigs": [desk.example(Rig)]}),
        desk.rig(latch=latch),
        httpx.Response(200, json=stopped),
    )
    assert main(["reset"]) == Exit.DONE
    assert capsys.readouterr().out == "rig demo: reset; the cause was: estop\n"


def test_every_exit_status_has_a_distinct_meaning() -> None:
    assert set(MEANINGS) == set(Exit)
    assert len({status.value for status in Exit}) == len(Exit)
