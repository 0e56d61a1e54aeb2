"""What the words of the command line make of a calibration's request, and how it is shown."""

import argparse
import io
from typing import Any

import pytest
from pydantic import TypeAdapter
from rich.console import Console

from pincette.api.request_base import StartRequest
from pincette.api.request_models import AnyJobRequest, Body
from pincette.cli import job_words, model
from pincette.cli.calibrate_words import CALIBRATIONS
from pincette.cli.follow import follow
from pincette.cli.main import parser
from pincette.cli.rest import Supervisor
from pincette.cli.show import show_result
from pincette.cli.show_model import show_calibration_plan, show_model, show_proposal

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
    item = {**VALUE, "source": "assumed"}
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


def test_a_plan_says_how_often_it_waits() -> None:
    console, out = screen()
    phases = [{"phase": "hang 1", "start_s": 0.0, "duration_s": None, "voltage_V": 0.0}]
    plan: dict[str, Any] = {"phases": phases, "rests_on": [], "feasible": True, "waits": 1}
    plan |= {"duration_s": 2.5, "voltage_min_V": 0.0, "voltage_max_V": 0.0}
    show_calibration_plan(plan, console)
    assert "waits for you" in out.getvalue()
    assert "feasible: 2.50 s, 1 waits" in out.getvalue()


class Waiting(Supervisor):
    """A job that waits twice for the same, and ends."""

    def __init__(self) -> None:
        live = {"phase": "hang 2", "elapsed_s": 1.0}
        live["instruction"] = "hang 5 mN on the tip, then POST the action continue"
        waiting = {"state": "running", "progress": live, "allowed_actions": ["stop", "continue"]}
        self._answers: list[dict[str, Any]] = [waiting, waiting, {"state": "succeeded"}]

    def get(self, path: str, **query: str | float) -> Any:
        assert (path, query["wait"]) == ("/jobs/j", "terminal")
        return self._answers.pop(0)


def test_who_follows_is_told_once_what_is_waited_for() -> None:
    console, out = screen()
    follow(Waiting(), "j", console)
    assert out.getvalue().count("hang 5 mN on the tip, then `pincette job continue j`") == 1


def test_the_words_of_the_model() -> None:
    top = argparse.ArgumentParser()
    model.add(top, lambda word: word.add_argument("--url", default="x") and None)
    assert vars(top.parse_args(["use", "3"])) == {"what": "use", "version": 3, "url": "x"}
    assert top.parse_args(["accept", "20260301"]).name == "20260301"
