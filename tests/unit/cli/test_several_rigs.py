"""The command line before a supervisor of several rigs."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from pincette.api.events import Event
from pincette.api.rigs import Rig
from pincette.cli import Exit, safety
from pincette.cli.main import main
from pincette.cli.safety import Tripped
from pincette.client import Supervisor
from pincette.config import RigFile
from tests.unit.client import desk
from tests.unit.client.desk import Desk

FILE = str(Path(__file__).parents[3] / "deploy" / "rigs" / "left.toml")
NAMES = ("left", "right")
At = Callable[..., Desk]


@pytest.fixture
def at(monkeypatch: pytest.MonkeyPatch) -> At:
    """Put a supervisor of prepared answers where the command line looks for one."""

    def place(*answers: Any) -> Desk:
        supervisor = Desk(*answers)

        def reached(_url: str, **_settings: Any) -> Supervisor:
            return supervisor.supervisor(0.0)

        monkeypatch.setattr("pincette.client.Supervisor", reached)
        return supervisor

    return place


@pytest.fixture
def past(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str | None]]:
    """Emergency stops past the supervisor: the file's rig, and the only one that is meant."""
    asked: list[tuple[str, str | None]] = []

    def trip(file: RigFile, only: str | None) -> Tripped:
        asked.append((file.rig.name, only))
        return Tripped({"left": "at the actuator"}, [] if only else ["right"], ["no answer"])

    monkeypatch.setattr(safety, "trip_past_supervisor", trip)
    return asked


def rigs(*names: str) -> httpx.Response:
    return httpx.Response(200, json={"rigs": [desk.example(Rig, name=name) for name in names]})


def stopped(*names: str) -> httpx.Response:
    entries = [
        {"rig": name, "cause": "estop", "acknowledged": True, "detail": ""} for name in names
    ]
    return httpx.Response(200, json={"rigs": entries})


def test_each_rig_has_a_line_with_what_keeps_it(at: At, capsys: pytest.CaptureFixture[str]) -> None:
    waiting = desk.example(Rig, name="right", can_start=False, reasons=["sensor: silent"])
    listed = {"rigs": [desk.example(Rig, name="left"), waiting]}
    at(httpx.Response(200, json=listed), httpx.Response(200, json=listed))
    assert main(["rigs"]) == Exit.DONE
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("left") and line.split()[-1] == "yes" for line in lines)
    assert any(line.startswith("right") and "sensor: silent" in line for line in lines)
    assert main(["rigs", "--json"]) == Exit.DONE
    assert [rig["name"] for rig in json.loads(capsys.readouterr().out)] == ["left", "right"]


@pytest.mark.parametrize(
    "words", [["stop"], ["reset"], ["job", "grip"], ["queue", "clear"], ["job", "show", "last"]]
)
def test_what_could_mean_two_is_refused_before_anything_is_asked_for(
    at: At, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    supervisor = at(rigs(*NAMES))
    assert main(words) == Exit.USAGE
    assert "serves 2: left, right. Name one of them with --rig-name" in capsys.readouterr().err
    assert supervisor.paths() == ["GET /api/v1/rigs"]


def test_an_emergency_stop_without_a_name_is_of_all(
    at: At, past: list[tuple[str, str | None]], capsys: pytest.CaptureFixture[str]
) -> None:
    supervisor = at(stopped(*NAMES))
    assert main(["estop", "--rig", FILE]) == Exit.DONE
    assert supervisor.paths() == ["POST /api/v1/estop"]
    said = capsys.readouterr().out.splitlines()
    assert said[:2] == [f"rig {name}: stopped through the supervisor" for name in NAMES]
    assert said[2].startswith("every rig is stopped, in ")
    assert past == []


def test_an_emergency_stop_of_one_is_of_that_one(
    at: At, past: list[tuple[str, str | None]], capsys: pytest.CaptureFixture[str]
) -> None:
    one = {"rig": "right", "cause": "estop", "acknowledged": True, "detail": ""}
    supervisor = at(httpx.Response(200, json=one))
    assert main(["estop", "--rig", FILE, "--rig-name", "right", "--json"]) == Exit.DONE
    assert supervisor.paths() == ["POST /api/v1/rigs/right/estop"]
    assert json.loads(capsys.readouterr().out)["stopped"] == {"right": "through the supervisor"}
    assert past == []


def test_the_rig_of_the_file_is_stopped_where_the_supervisor_does_not_serve_it(
    at: At, past: list[tuple[str, str | None]], capsys: pytest.CaptureFixture[str]
) -> None:
    at(stopped("other"))
    assert main(["estop", "--rig", FILE]) == Exit.DONE
    assert past == [("left", "left")]
    assert "rig left: stopped at the actuator" in capsys.readouterr().out


def test_one_that_no_way_has_stopped_is_named(
    at: At, past: list[tuple[str, str | None]], capsys: pytest.CaptureFixture[str]
) -> None:
    at(desk.problem(503, "estop-unconfirmed", reasons=["right: nobody answers"]))
    assert main(["estop", "--rig", FILE]) == Exit.FAILED
    said = capsys.readouterr().err
    assert "rig right could not be stopped from here: take the amplifier's power away" in said
    assert "stopped: left" in said
    assert "right: nobody answers" in said
    assert past == [("left", None)]


def test_events_of_all_are_followed_where_none_is_named(
    at: At, capsys: pytest.CaptureFixture[str]
) -> None:
    events = [
        desk.example(Event, number=number, rig=rig, job=None, kind="rig", body={"found": "found"})
        for number, rig in enumerate(NAMES, 1)
    ]

    def over(_request: httpx.Request) -> httpx.Response:
        raise KeyboardInterrupt

    supervisor = at(rigs(*NAMES), desk.stream(*events), over)
    assert main(["watch", "--after", "0"]) == Exit.INTERRUPTED
    assert supervisor.paths()[1] == "GET /api/v1/events"
    told = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in told] == list(NAMES)
