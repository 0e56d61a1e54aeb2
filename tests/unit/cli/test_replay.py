"""A recorded job through the estimator alone: the same to the last bit, or the first difference."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from pincette.api.request_models import GripJobRequest
from pincette.cli import replay
from pincette.cli.main import main
from pincette.messages import Estimate, Message, Position
from pincette.records.mcap_reading import Recording
from pincette.runtime.composed import ComposedLoop
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.rigs import demo_rig

RIG = demo_rig(time="lockstep")
ABOUT = {"epoch": "1", "period_s": "0.02"}
Recorded = Callable[..., None]


@cache
def played() -> tuple[Message, ...]:
    request = GripJobRequest(kind="grip", hold_s=0.5, load_s=0.5)
    return tuple(ComposedLoop(RIG).play(plan_job(request, RIG).program))


def recording(messages: list[Message]) -> Recording:
    return Recording(ABOUT, None, messages, {"rig.json": RIG.model_dump_json().encode()})


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> Recorded:
    """Put recordings where records are read, by the name of the folder."""

    def place(**found: Recording) -> None:
        def read(path: Path) -> Recording:
            return found[path.stem]

        monkeypatch.setattr(replay, "read", read)

    return place


def test_a_record_is_repeated_to_the_last_bit(
    recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(job=recording(list(played())))
    assert main(["replay", "job"]) == 0
    count = sum(isinstance(message, Estimate) for message in played())
    assert f"{count} samples, the same to the last bit" in capsys.readouterr().out


def test_the_first_difference_is_said(
    recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = [
        replace(message, force_mN=message.force_mN + 1e-12)
        if isinstance(message, Estimate) and message.seq in (40, 41)
        else message
        for message in played()
    ]
    recorded(job=recording(wrong))
    assert main(["replay", "job", "--json"]) == 1
    (found,) = json.loads(capsys.readouterr().out)
    assert [one["seq"] for one in found["differences"]] == [40, 41]
    assert list(found["differences"][0]["fields"]) == ["force_mN"]
    assert main(["replay", "job"]) == 1
    assert "2 of" in capsys.readouterr().out


def test_what_came_before_counts(recorded: Recorded, capsys: pytest.CaptureFixture[str]) -> None:
    moved = [
        replace(message, x_um=message.x_um + 0.5) if isinstance(message, Position) else message
        for message in played()
    ]
    recorded(job=recording(moved))
    assert main(["replay", "job"]) == 1
    assert "the service remembers what came before" in capsys.readouterr().out


def test_what_cannot_be_replayed_is_said(
    recorded: Recorded, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["replay", str(tmp_path)]) == 1
    assert "job.mcap cannot be read" in capsys.readouterr().err
    recorded(job=Recording(ABOUT, None, []))
    assert main(["replay", "job"]) == 1
    assert "holds no rig.json" in capsys.readouterr().err
    recorded(job=recording([]))
    assert main(["replay", "job"]) == 1
    assert "holds nothing that the estimator has said" in capsys.readouterr().err
