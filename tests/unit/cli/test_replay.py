"""Recorded jobs are replayed through their services: identical to the last bit, or the first
difference is reported."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from pincette.cli.main import main
from pincette.core.messages import Estimate, Message, RequestLog
from pincette.engine.composed import ComposedLoop
from pincette.records.mcap_reading import Recording
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.arms import with_arm
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

        monkeypatch.setattr("pincette.engine.replay.recorded.read", read)

    return place


def wrong() -> list[Message]:
    return [
        with_arm(message, force_mN=message.arms[0].force_mN + 1e-12)
        if isinstance(message, Estimate) and message.seq in (40, 41)
        else message
        for message in played()
    ]


def test_a_record_is_reproduced_bit_for_bit(
    recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(job=recording(list(played())))
    assert main(["records", "replay", "job"]) == 0
    count = sum(isinstance(message, Estimate) for message in played())
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["estimator", f"{count}", f"{count}", "0"] in rows
    assert ["controller", f"{count}", f"{2 * count}", "0"] in rows
    assert ["actuator", f"{2 * count}", f"{count}", "0"] in rows


def test_the_first_difference_is_reported(
    recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(job=recording(wrong()))
    assert main(["records", "replay", "job", "--service", "estimator", "--json"]) == 1
    (found,) = json.loads(capsys.readouterr().out)
    (estimator,) = found["services"]
    assert (estimator["different"], estimator["stopped"]) == (2, "")
    first = estimator["first"]
    assert (first["topic"], first["seq"], first["field"]) == ("estimate", 40, "force_mN")
    assert first["recorded"] - first["replayed"] == pytest.approx(1e-12, rel=1e-3)
    assert main(["records", "replay", "job", "--service", "estimator"]) == 1
    assert "estimate 40, force_mN:" in capsys.readouterr().out


def test_another_force_gives_another_command(
    recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(job=recording(wrong()), good=recording(list(played())))
    assert main(["records", "replay", "good", "job", "--json"]) == 1
    good, bad = json.loads(capsys.readouterr().out)
    assert (good["record"], bad["record"]) == ("good", "job")
    assert [one["different"] for one in good["services"]] == [0, 0, 0]
    assert [one["different"] > 0 for one in bad["services"]] == [True, True, False]


def test_zero_and_minus_zero_differ(recorded: Recorded, capsys: pytest.CaptureFixture[str]) -> None:
    turned = [
        with_arm(message, force_mN=-message.arms[0].force_mN)
        if isinstance(message, Estimate) and message.seq == 0
        else message
        for message in played()
    ]
    recorded(job=recording(turned))
    assert main(["records", "replay", "job", "--service", "estimator", "--json"]) == 1
    (found,) = json.loads(capsys.readouterr().out)
    first = found["services"][0]["first"]
    assert (first["seq"], str(first["recorded"]), str(first["replayed"])) == (0, "-0.0", "0.0")


def test_an_impossible_replay_is_reported(
    recorded: Recorded, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["records", "replay", str(tmp_path)]) == 1
    assert "job.mcap cannot be read" in capsys.readouterr().err
    recorded(job=Recording(ABOUT, None, []))
    assert main(["records", "replay", "job"]) == 1
    assert "holds no rig.json" in capsys.readouterr().err
    older: list[Message] = [message for message in played() if not isinstance(message, RequestLog)]
    recorded(job=recording(older))
    assert main(["records", "replay", "job"]) == 1
    output = capsys.readouterr().out
    for name in ("estimator", "controller", "actuator"):
        assert f"{name}: replay stopped here: its arming is not in the record" in output
