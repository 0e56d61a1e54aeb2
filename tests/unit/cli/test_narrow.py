"""On a narrow terminal no word and no number is broken, and a pipe has whole lines."""

import io
import re
from typing import Any

import httpx
import pytest

from pincette.api.calibrations import Proposal
from pincette.api.checks import Check
from pincette.api.events import Alarm
from pincette.api.jobs import Artifact, Job
from pincette.api.live import LoopTiming
from pincette.api.plans import Plan
from pincette.api.results import ClosedLoopResult
from pincette.api.rigs import Rig
from pincette.cli.main import main
from tests.unit.client import desk

from .conftest import At

NARROW = 50
STYLE = re.compile(r"\x1b\[[0-9;]*m")
AT = ("--rig-name", "demo")
RECORD = "data/jobs/of-a-folder-whose-name-is-longer-than-the-line/20260301-120000-1c97"
JOB = desk.example(
    Job,
    state="succeeded",
    record=RECORD,
    result=desk.example(ClosedLoopResult),
    labels={"part": "b12"},
)
RIG = desk.example(
    Rig, checks=[desk.example(Check)], can_start=False, reasons=["sensor: silent for 62 ms"]
)


def listed(**members: Any) -> httpx.Response:
    return httpx.Response(200, json=members)


ANSWERS: dict[tuple[str, ...], list[httpx.Response]] = {
    ("rigs",): [listed(rigs=[RIG])],
    ("rigs", "demo"): [httpx.Response(200, json=RIG)],
    ("job", "list"): [listed(jobs=[JOB, JOB])],
    ("job", "show", "x"): [
        httpx.Response(200, json=JOB),
        listed(artifacts=[desk.example(Artifact)]),
    ],
    ("plan", "grip"): [httpx.Response(200, json=desk.example(Plan))],
    ("alarms", "list"): [listed(alarms=[desk.example(Alarm)], next=None)],
    ("model", "proposals"): [listed(calibrations=[desk.example(Proposal)])],
    ("latency", "--of-rig"): [httpx.Response(200, json=desk.example(LoopTiming))],
}


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        return True


def words(text: str) -> set[str]:
    return {word.rstrip(":") for word in text.replace("─", " ").split()}


@pytest.mark.parametrize("command", ANSWERS, ids=" ".join)
def test_a_narrow_terminal_breaks_lines_between_words_only(
    command: tuple[str, ...], at: At, monkeypatch: pytest.MonkeyPatch
) -> None:
    printed: list[str] = []
    for stream in (io.StringIO(), Terminal()):
        at(*ANSWERS[command])
        monkeypatch.setenv("COLUMNS", str(NARROW))
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.setattr("sys.stdout", stream)
        main([*command, *(AT if command[0] != "rigs" else ())])
        printed.append(STYLE.sub("", stream.getvalue()))
    whole, narrow = printed
    assert words(narrow) <= words(whole)
    long = [line for line in narrow.splitlines() if len(line) > NARROW]
    assert [line for line in long if len(line.split()) > 1] == []
    if RECORD in whole:
        assert RECORD in narrow
