"""The example of an orchestrator, with a supervisor of prepared replies."""

import json
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from pincette import client
from pincette.api.events import Event
from pincette.api.jobs import Job

from . import desk
from .desk import Desk

EXAMPLE = Path(__file__).parents[3] / "docs/examples/orchestrator.py"
NAME = desk.example(Job)["id"]
RIGS = httpx.Response(200, json={"rigs": [desk.example(desk.Rig)]})
LET_GO = desk.job(state="succeeded", result={"outcome": "released", "peak_force_mN": 15.2})
Run = Callable[..., tuple[int, Desk]]


def held() -> httpx.Response:
    return desk.stream(
        desk.example(Event, number=1, kind="phase", body={"phase": "load"}),
        desk.example(Event, number=2, kind="phase", body={"phase": "hold"}),
    )


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    def play(
        *answers: Any, words: tuple[str, ...] = (), kept: list[Desk] | None = None
    ) -> tuple[int, Desk]:
        supervisor = Desk(*answers)
        if kept is not None:
            kept.append(supervisor)

        def reached(_url: str, **_settings: Any) -> client.Supervisor:
            return supervisor.supervisor()

        monkeypatch.setattr(client, "Supervisor", reached)
        monkeypatch.setattr("time.sleep", supervisor.sleep)
        monkeypatch.setattr(sys, "argv", [str(EXAMPLE), *words])
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(str(EXAMPLE), run_name="__main__")
        return int(str(ended.value.code)), supervisor

    return play


def test_a_part_is_picked_held_and_released(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    status, supervisor = run(RIGS, desk.job(), held(), desk.job(), LET_GO)
    assert status == 0
    assert "released, peak force 15.20 mN" in capsys.readouterr().out
    body = json.loads(supervisor.asked[1].content)
    assert (body["until_released"], body["force_mN"]) == (True, 15.0)
    assert supervisor.asked[1].headers["Idempotency-Key"].endswith("-part-1")
    assert json.loads(supervisor.asked[3].content) == {"type": "release"}
    assert supervisor.slept_s == [1.0]


def test_the_client_waits_for_a_busy_rig_and_resumes_a_broken_connection(run: Run) -> None:
    busy, lost = desk.problem(409, "job-active"), httpx.ReadError("lost")
    status, supervisor = run(RIGS, busy, lost, desk.job(), lost, held(), desk.job(), LET_GO)
    assert status == 0
    keys = {one.headers.get("Idempotency-Key") for one in supervisor.asked[1:4]}
    assert len(keys) == 1


def test_a_missing_part_does_not_end_the_run(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    failed = desk.job(state="failed", cause="no_contact: nothing was met")
    status, _ = run(
        *(RIGS, desk.job(), desk.stream(), failed, failed),
        *(desk.job(), held(), desk.job(), LET_GO),
        words=("--parts", "2"),
    )
    assert status == 1
    output = capsys.readouterr()
    assert "no_contact: nothing was met" in output.err
    assert "released" in output.out


def test_a_latched_rig_needs_a_person(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    status, supervisor = run(RIGS, desk.problem(409, "rig-latched"))
    assert status == 4
    assert "a person is needed: Title: detail" in capsys.readouterr().err
    assert len(supervisor.asked) == 2


def test_an_interrupted_run_leaves_the_part_held(run: Run) -> None:
    requests: list[bytes] = []

    def interrupted(_request: httpx.Request) -> httpx.Response:
        raise KeyboardInterrupt

    def stopping(request: httpx.Request) -> httpx.Response:
        requests.append(request.content)
        return desk.job(state="stopping")

    status, _ = run(RIGS, desk.job(), interrupted, stopping)
    assert status == 130
    assert [json.loads(body) for body in requests] == [{"type": "stop"}]


def test_a_part_lost_during_the_motion_is_counted(
    run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    over = desk.problem(409, "invalid-transition")
    lost = desk.job(state="failed", cause="lost: nothing presses any more")
    status, _ = run(RIGS, desk.job(), held(), over, lost)
    assert status == 1
    assert "lost: nothing presses any more" in capsys.readouterr().err


def test_a_part_not_released_in_time_needs_a_person(
    run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    def late(_request: httpx.Request) -> httpx.Response:
        supervisor[0].now_s += 61.0
        return desk.job()

    supervisor: list[Desk] = []
    answers = (RIGS, desk.job(), held(), desk.job(), late)
    status, _ = run(*answers, kept=supervisor)
    assert status == 4
    assert "continues" in capsys.readouterr().err


def test_the_example_is_short() -> None:
    assert len(EXAMPLE.read_text(encoding="utf-8").splitlines()) <= 120
