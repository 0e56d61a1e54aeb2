"""On a narrow terminal no word and no number is broken, and a pipe has whole lines."""

import io
import re
from collections.abc import Callable
from typing import Any

import httpx
import pytest
from rich.console import Console

from pincette.api.calibrations import Proposal
from pincette.api.checks import Check
from pincette.api.events import Alarm, Event
from pincette.api.job_kinds import job_kinds
from pincette.api.jobs import Artifact, Job, Progress
from pincette.api.live import LoopTiming
from pincette.api.pairs import PairResult
from pincette.api.places import PlaceList
from pincette.api.plans import Plan
from pincette.api.results import ClosedLoopResult, MotionResult, ReleaseVerdict
from pincette.api.rigs import Rig
from pincette.api.series import Series
from pincette.cli import doctor, watch
from pincette.cli.main import main
from pincette.cli.results import show_result
from pincette.cli.terminal import screen, table
from pincette.diagnostics import Finding, Mark
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


Both = Callable[[Callable[[], object]], tuple[str, str]]


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
    ("job", "show", "x", "--all"): [
        httpx.Response(200, json=JOB),
        listed(artifacts=[desk.example(Artifact)]),
    ],
    ("plan", "grip"): [httpx.Response(200, json=desk.example(Plan))],
    ("alarms",): [listed(alarms=[desk.example(Alarm)], open=1, next=None)],
    ("model", "show", "--proposals"): [listed(calibrations=[desk.example(Proposal)])],
    ("places",): [httpx.Response(200, json=desk.example(PlaceList))],
    ("series", "list"): [listed(series=[desk.example(Series)])],
    ("series", "show"): [
        listed(series=[desk.example(Series)]),
        httpx.Response(200, json=desk.example(Series)),
    ],
    ("latency", "--of-rig"): [httpx.Response(200, json=desk.example(LoopTiming))],
}


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        return True


def words(text: str) -> set[str]:
    return {word.rstrip(":") for word in text.replace("─", " ").split()}


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> Both:
    """Return the outputs of a call into a pipe and in a narrow terminal."""

    def outputs(call: Callable[[], object]) -> tuple[str, str]:
        printed: list[str] = []
        for stream in (io.StringIO(), Terminal()):
            monkeypatch.setenv("COLUMNS", str(NARROW))
            monkeypatch.setenv("TERM", "xterm")
            monkeypatch.setattr("sys.stdout", stream)
            call()
            printed.append(STYLE.sub("", stream.getvalue()))
        return printed[0], printed[1]

    return outputs


def assert_only_broken_between_words(whole: str, narrow: str) -> None:
    assert words(narrow) <= words(whole)
    long = [line for line in narrow.splitlines() if len(line) > NARROW]
    assert [line for line in long if len(line.split()) > 1] == []
    if RECORD in whole:
        assert RECORD in narrow


@pytest.mark.parametrize("command", ANSWERS, ids=" ".join)
def test_a_narrow_terminal_breaks_lines_only_between_words(
    command: tuple[str, ...], at: At, both: Both
) -> None:
    def call() -> None:
        at(*ANSWERS[command])
        main([*command, *(AT if command[0] != "rigs" else ())])

    assert_only_broken_between_words(*both(call))


@pytest.mark.parametrize("width", [50, 60, 74, 80, 100])
def test_a_table_with_a_long_name_in_a_text_breaks_no_word(
    width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setenv("TERM", "xterm")
    row = (
        "2",
        "2026-11-29 22:30:06+00:00",
        "demo",
        "the record of job 20261129-221919-5b9f5e lacks messages: 1 message was not received",
        "1",
        "not acknowledged",
    )
    names = ("id", "came", "rig", "what", "times", "state")
    stream = Terminal()
    monkeypatch.setattr("sys.stdout", stream)
    screen().print(table(*names, rows=[row], right=["times"]))
    narrow = STYLE.sub("", stream.getvalue())
    assert words(narrow) == words(" ".join([*names, *row]))
    assert max(len(line) for line in narrow.splitlines()) <= width


RESULTS = {
    "grip": desk.example(ClosedLoopResult),
    "grip of two arms": desk.example(PairResult),
    "hold": desk.example(MotionResult, held_at_end=True),
    "move": desk.example(MotionResult),
    "release": desk.example(MotionResult, release=desk.example(ReleaseVerdict)),
    "track": desk.example(ClosedLoopResult),
}


@pytest.mark.parametrize("name", RESULTS)
@pytest.mark.parametrize("everything", [False, True], ids=["main", "all"])
def test_the_result_of_a_job_fits_in_a_narrow_terminal(
    name: str, everything: bool, both: Both
) -> None:
    kind = name.split()[0]
    assert kind in job_kinds()
    members = desk.example(Job, kind=kind, state="succeeded", record=RECORD, result=RESULTS[name])
    job = Job.model_validate(members)
    whole, narrow = both(lambda: show_result(job, screen(), everything=everything))
    assert RECORD in whole
    assert_only_broken_between_words(whole, narrow)


@pytest.mark.parametrize("mark", ["ok", "note", "missing"])
def test_a_finding_of_doctor_fits_in_a_narrow_terminal(mark: Mark, both: Both) -> None:
    finding = Finding(
        mark != "missing",
        "bus: session 46aff3e1c0550176a53a6896b1660c4b subscribes to pincette/v2/demo/place, "
        "pincette/v2/demo/position, and sensor exchange 2.6 + computing 2.0 = 16.9 ms",
        "`pincette latency --seconds 5 --period-s 0.02` measures the machine",
        note=mark == "note",
    )
    assert finding.mark == mark
    whole, narrow = both(lambda: doctor._show(finding, screen()))  # pyright: ignore[reportPrivateUsage]
    assert_only_broken_between_words(whole, narrow)


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        ("phase", {"phase": "approach", "job_kind": "grip", "x_um": 27.1234}),
        ("alarm", {"did": "raised", "alarm": desk.example(Alarm), "words": "the force is unknown"}),
        ("state", {"state": "failed", "cause": "no_contact: the part was not touched at 33.1 µm"}),
    ],
)
def test_a_watched_event_fits_in_a_narrow_terminal(
    kind: str, body: dict[str, Any], both: Both
) -> None:
    event = Event.model_validate(desk.example(Event, kind=kind, body=body))
    assert_only_broken_between_words(*both(lambda: screen().print(watch.line(event))))


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
