"""On a narrow terminal no word and no number is broken, and a pipe has whole lines."""

import io
import re
from typing import Any

import httpx
import pytest
from rich.console import Console

from pincette.api.calibrations import Proposal
from pincette.api.checks import Check
from pincette.api.events import Alarm
from pincette.api.jobs import Artifact, Job, Progress
from pincette.api.live import LoopTiming
from pincette.api.plans import Plan
from pincette.api.results import ClosedLoopResult
from pincette.api.rigs import Rig
from pincette.cli import watch
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
    ("alarms",): [listed(alarms=[desk.example(Alarm)], open=1, next=None)],
    ("model", "show", "--proposals"): [listed(calibrations=[desk.example(Proposal)])],
    ("latency", "--of-rig"): [httpx.Response(200, json=desk.example(LoopTiming))],
}


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        return True


def words(text: str) -> set[str]:
    return {word.rstrip(":") for word in text.replace("─", " ").split()}


@pytest.mark.parametrize("command", ANSWERS, ids=" ".join)
def test_a_narrow_terminal_breaks_lines_only_between_words(
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


def test_a_long_message_keeps_its_parts_in_a_narrow_terminal(
    at: At, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    printed: list[str] = []
    for stream in (io.StringIO(), Terminal()):
        at(httpx.ConnectError("Connection refused"))
        monkeypatch.setenv("COLUMNS", str(NARROW))
        monkeypatch.setattr("sys.stderr", stream)
        main(["job", "grip", "--force-mN", "15", "--recipe", "bead-of-1400-um", *AT])
        printed.append(stream.getvalue())
    whole, narrow = printed
    assert narrow.split() == whole.split()
    assert [one for one in narrow.splitlines() if len(one) > NARROW and len(one.split()) > 1] == []
    parts = [line.split(":")[0] for line in whole.splitlines()[1:]]
    assert parts == ["pincette", "  why", "  remedy", "  remedy", "  remedy"]
    lines = narrow.splitlines()
    later = lines[lines.index(next(line for line in lines if line.startswith("  why"))) :]
    assert all(line.startswith("  ") for line in later)
    assert capsys.readouterr().out == ""


def test_the_progress_of_a_job_fits_in_a_narrow_terminal() -> None:
    live = desk.example(Progress, phase="approach", elapsed_s=8.0, planned_s=16.0, x_um=140.25)
    job = Job.model_validate(desk.example(Job, state="running", progress=live | {"force_mN": 19.5}))
    stream = Terminal()
    console = Console(file=stream, width=NARROW, force_terminal=True, color_system=None)
    bar = watch._Bar(console)  # pyright: ignore[reportPrivateUsage]
    with bar:
        bar.show(job, job.progress)
    assert "approach   50% 140.25 µm  19.50 mN  8.0 s left" in stream.getvalue()
    assert "…" not in stream.getvalue()
