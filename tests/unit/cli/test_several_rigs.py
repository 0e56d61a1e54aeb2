"""The command line with a supervisor of several rigs."""

import json

import httpx
import pytest

from pincette.api.events import Event
from pincette.api.rigs import Rig
from pincette.cli import Exit
from pincette.cli.main import main
from tests.unit.client import desk

from .conftest import At

NAMES = ("left", "right")


def rigs(*names: str) -> httpx.Response:
    return httpx.Response(200, json={"rigs": [desk.example(Rig, name=name) for name in names]})


def test_each_rig_has_a_line_with_the_reason_why_it_cannot_start(
    at: At, capsys: pytest.CaptureFixture[str]
) -> None:
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
def test_an_ambiguous_rig_is_refused_before_any_request(
    at: At, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    supervisor = at(rigs(*NAMES))
    assert main(words) == Exit.USAGE
    assert "serves 2: left, right. Name one of them with --rig-name" in capsys.readouterr().err
    assert supervisor.paths() == ["GET /api/v1/rigs"]


def test_without_a_name_the_events_of_all_rigs_are_followed(
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
    output = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in output] == list(NAMES)
