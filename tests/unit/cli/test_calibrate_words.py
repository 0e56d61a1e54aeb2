"""What the words of the command line make of a calibration's request, and how it is shown."""

import io
from typing import Any

import pytest
from pydantic import TypeAdapter
from rich.console import Console

from pincette.api.calibration_models import CalibrationPhase, CalibrationPlan
from pincette.api.job_models import Job, Progress
from pincette.api.request_base import StartRequest
from pincette.api.request_models import AnyJobRequest, Body
from pincette.cli import job_words
from pincette.cli.calibrate_words import CALIBRATIONS
from pincette.cli.follow import follow
from pincette.cli.main import parser
from pincette.cli.show import show_result
from pincette.cli.show_model import show_model, show_proposal
from pincette.cli.show_plan import show_plan
from tests.unit.client import desk

REQUEST: TypeAdapter[AnyJobRequest] = TypeAdapter(Body)
VALUE: dict[str, Any] = {
    "quantity": "model.compliance_um_per_mN",
    "value": 0.4583,
    "unit": "µm/mN",
    "uncertainty": 0.0011,
}


def wishes(*words: str) -> dict[str, Any]:
    return job_words.wishes(parser().parse_args(["job", "calibrate", *words]))


def screen() -> tuple[Console, io.StringIO]:
    out = io.StringIO()
    return Console(file=out, width=100, color_system=None), out


def test_only_what_was_given_is_asked_for() -> None:
    assert wishes("noise") == {"calibration": "noise"}
    assert wishes("compliance", "--weights-mN", "0,5,10") == {
        "calibration": "compliance",
        "weights_mN": [0.0, 5.0, 10.0],
    }
    assert wishes("free_response", "--low-V", "-0.5", "--high-V", "3") == {
        "calibration": "free_response",
        "low_V": -0.5,
        "high_V": 3.0,
    }


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_words_are_members_of_the_request(name: str) -> None:
    request = REQUEST.validate_python({"kind": "calibrate", "calibration": name})
    own = set(type(request).model_fields) - set(StartRequest.model_fields)
    assert set(CALIBRATIONS[name][1]) <= own - {"kind", "calibration"}


def test_what_cannot_be_read_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        wishes("compliance", "--weights-mN", "0,heavy")
    assert "'heavy' mN cannot be used" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        wishes("colour")
    assert "invalid choice: 'colour'" in capsys.readouterr().err


def test_a_calibration_is_shown_with_what_to_do_next() -> None:
    console, out = screen()
    result: dict[str, Any] = {
        "calibration": "compliance",
        "outcome": "moved",
        "phases": [],
        "values": [VALUE],
        "figures": [{"name": "drift", "value": 0.001, "unit": "µm/s", "meaning": ""}],
        "statement": "sure",
        "warnings": ["rests on something"],
    }
    show_result({"id": "j", "state": "succeeded", "result": result, "record": None}, console)
    text = out.getvalue()
    for words in (
        "model.compliance_um_per_mN         0.4583 µm/mN ± 0.0011",
        "warning: rests on something",
        "`pincette model accept j` uses it",
    ):
        assert words in text


def test_a_proposal_and_the_model_are_shown() -> None:
    console, out = screen()
    beside = {**VALUE, "in_use": 0.46, "difference_percent": -0.37}
    proposal = {"calibration": "compliance", "id": "j", "state": "accepted", "model_version": 2}
    show_proposal({**proposal, "values": [beside]}, console)
    item = {**VALUE, "source": "assumed", "due_at": "2026-08-28T12:01:10.000Z", "overdue": True}
    found: dict[str, Any] = {
        "rig": "demo",
        "version": 2,
        "digest": "3f",
        "trouble": "",
        "versions": [],
    }
    show_model({**found, "quantities": [item]}, console)
    assert "compliance j: accepted, model 2" in out.getvalue()
    assert "before 0.46 µm/mN (-0.37 %)" in out.getvalue()
    assert "assumed" in out.getvalue()
    assert "2026-08-28, overdue" in out.getvalue()


def test_a_plan_says_how_often_it_waits() -> None:
    console, out = screen()
    plan = desk.example(CalibrationPlan, phases=[desk.example(CalibrationPhase)], waits=1)
    show_plan(CalibrationPlan.model_validate(plan), console)
    assert "waits for you" in out.getvalue()
    assert "feasible: 8.00 s, 1 waits" in out.getvalue()


def test_who_follows_is_told_once_what_is_waited_for() -> None:
    console, out = screen()
    instruction = "hang 5 mN on the tip, then POST the action continue"
    live = desk.example(Progress, phase="hang 2", instruction=instruction)
    waiting = desk.job(state="running", progress=live, allowed_actions=["stop", "continue"])
    supervisor = desk.Desk(waiting, waiting, waiting, desk.job(id="j", state="succeeded"))
    follow(supervisor.supervisor().job("j"), console)
    name = desk.example(Job)["id"]
    assert out.getvalue().count(f"hang 5 mN on the tip, then `pincette job continue {name}`") == 1


def test_the_words_of_the_model() -> None:
    given = parser().parse_args(["model", "use", "3"])
    assert (given.what, given.version, given.json) == ("use", 3, False)
    assert parser().parse_args(["model", "accept", "20260301"]).name == "20260301"


def test_calibrate_is_short_for_a_job() -> None:
    short = parser().parse_args(["calibrate", "noise", "--duration-s", "3"])
    long = parser().parse_args(["job", "calibrate", "noise", "--duration-s", "3"])
    assert (short.kind, short.call) == (long.kind, long.call)
    assert job_words.wishes(short) == job_words.wishes(long)
