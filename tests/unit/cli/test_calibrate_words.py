"""Requests that the command line makes for a calibration, and its output."""

import io
from typing import Any

import pytest
from rich.console import Console

from pincette.api.calibrations import CalibrationPlan
from pincette.api.jobs import Job, Progress
from pincette.api.plans import PlannedPhase
from pincette.cli import Exit
from pincette.cli.main import main
from pincette.cli.model import show_model, show_proposal
from pincette.cli.results import show_plan, show_result
from pincette.cli.watch import follow
from tests.support.command_line import parsed, request_of
from tests.unit.client import desk

VALUE: dict[str, Any] = {
    "quantity": "model.compliance_um_per_mN",
    "value": 0.4583,
    "unit": "µm/mN",
    "uncertainty": 0.0011,
}


def fields(*words: str) -> dict[str, Any]:
    return request_of("job", "calibrate", *words)


def screen() -> tuple[Console, io.StringIO]:
    out = io.StringIO()
    return Console(file=out, width=100, color_system=None), out


def test_only_given_options_are_requested() -> None:
    assert fields("noise") == {}
    assert fields("compliance", "--weights-mN", "0; 5; 10") == {"weights_mN": [0.0, 5.0, 10.0]}
    assert fields("free_response", "--low-V", "-0.5", "--high-V", "3") == {
        "low_V": -0.5,
        "high_V": 3.0,
    }


def test_unreadable_options_are_reported(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["job", "calibrate", "compliance", "--weights-mN", "0,heavy"]
    assert main(words) == Exit.USAGE
    assert "'heavy' mN cannot be used" in capsys.readouterr().err
    assert main(["job", "calibrate", "complience"]) == Exit.USAGE
    assert "Did you mean 'compliance'?" in capsys.readouterr().err


def test_a_calibration_is_shown_with_the_next_step() -> None:
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
    job = desk.example(Job, id="j", state="succeeded", result=result, record=None)
    show_result(Job.model_validate(job), console)
    text = out.getvalue()
    for words in (
        "model.compliance_um_per_mN 0.4583 µm/mN ± 0.0011",
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


def test_a_plan_states_how_often_it_waits() -> None:
    console, out = screen()
    plan = desk.example(
        CalibrationPlan, phases=[desk.example(PlannedPhase, duration_s=None)], waits=1
    )
    show_plan(CalibrationPlan.model_validate(plan), console)
    assert "waits for you" in out.getvalue()
    assert "feasible: 8.00 s, 1 waits" in out.getvalue()


def test_the_command_line_prints_once_what_a_job_waits_for() -> None:
    console, out = screen()
    instruction = "hang 5 mN on the tip"
    live = desk.example(Progress, phase="hang 2", instruction=instruction)
    waiting = desk.job(state="running", progress=live, allowed_actions=["stop", "continue"])
    supervisor = desk.Desk(waiting, waiting, waiting, desk.job(id="j", state="succeeded"))
    follow(supervisor.supervisor().job("j"), console)
    name = desk.example(Job)["id"]
    assert out.getvalue().count(f"hang 5 mN on the tip, then `pincette job continue {name}`") == 1


def test_the_arguments_of_model_commands_are_parsed() -> None:
    assert parsed("model", "use", "3").params["version"] == 3
    assert parsed("model", "accept", "20260301").params["name"] == "20260301"
