"""Jobs of one rig, one after the other: each record is replayed alone, to the last bit."""

from functools import cache
from pathlib import Path

import pytest
from msgspec.structs import replace

from pincette.api.requests import JobRequest
from pincette.config import Calibration
from pincette.control.planning.program import Program
from pincette.control.quantities import Document
from pincette.core import plugins
from pincette.core.messages import Estimate, Message, Position, RequestLog, Telemetry
from pincette.engine.replay.comparison import Difference, Findings
from pincette.engine.replay.recorded import recorded_epoch, recorded_rig
from pincette.engine.replay.service_alone import replay
from pincette.engine.replay.steps import STEPS
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.motions import MoveJobRequest
from pincette_supervisor.kinds.track import TrackJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Present
from tests.replay.desk import Desk, Watch, at, nobody, recorded
from tests.support.rigs import demo_rig

RIG = demo_rig({"safety": {"freeze_s": 0.2}}, time="lockstep")
SHORT = GripJobRequest(kind="grip", hold_s=0.4, load_s=0.5)
LONG = GripJobRequest(kind="grip", until_released=True, load_s=0.5)
FOUND = Calibration(values={"model.compliance_um_per_mN": 0.47, "model.creep_mN_per_decade": 0.2})


def pause_and_resume(desk: Desk, message: Telemetry | object) -> None:
    """Pause in the hold, resume some ticks later, and then release."""
    if not isinstance(message, Telemetry) or message.phase != "hold":
        return
    for tick, action in ((5, "pause"), (30, "release")):
        if message.segment_tick == tick and not message.paused:
            desk.act(action)
    if message.paused and message.seq % 7 == 0:
        desk.act("resume")


def stop_and_let_go(desk: Desk, message: Telemetry | object) -> None:
    if isinstance(message, Telemetry) and message.playing and message.phase == "hold":
        stopped = message.segment < 0
        if message.segment_tick == 10:
            desk.act("release" if stopped else "stop")


JOBS: tuple[tuple[str, JobRequest, Watch, str], ...] = (
    ("grip", SHORT, nobody, ""),
    ("after a grip", SHORT, nobody, ""),
    ("paused", LONG, pause_and_resume, ""),
    ("stopped and let go", LONG, stop_and_let_go, ""),
    ("another model", SHORT, nobody, FOUND.text()),
    ("stopped free", LONG, at("approach", 5, lambda desk: desk.act("stop")), FOUND.text()),
    ("tripped free", LONG, at("approach", 9, Desk.trip), ""),
    ("moved", MoveJobRequest(kind="move", to_um=30.0), nobody, FOUND.text()),
    ("track", TrackJobRequest(kind="track", load_s=0.5, frequency_hz=2.0, cycles=1), nobody, ""),
    ("dsmifc", GripJobRequest(kind="grip", hold_s=0.4, load_s=0.5, scheme="dsmifc"), nobody, ""),
    ("tripped held", LONG, at("hold", 10, Desk.trip), ""),
)


def program_of(request: JobRequest, desk: Desk) -> Program:
    return plan_job(request, RIG, Present(desk.voltage_V, desk.x_um, desk.held)).program


@cache
def played() -> dict[str, tuple[Message, ...]]:
    """Messages of each job, in the order in which the jobs were played."""
    desk = Desk(RIG)
    found: dict[str, tuple[Message, ...]] = {}
    for epoch, (name, request, watch, calibration) in enumerate(JOBS, start=1):
        found[name] = tuple(desk.play(program_of(request, desk), epoch, watch, calibration))
        desk.reset()
    return found


def repeated(folder: Path, name: str) -> list[Findings]:
    epoch = 1 + list(played()).index(name)
    recording = recorded(folder / name, RIG, list(played()[name]), epoch)
    messages = recorded_epoch(recording)
    rig = recorded_rig(recording, folder)
    return [replay(plugins.load(plugins.SERVICES, one), rig, messages) for one in STEPS]


@pytest.mark.parametrize("name", [name for name, *_ in JOBS])
def test_a_record_is_reproduced_without_earlier_records(tmp_path: Path, name: str) -> None:
    for found in repeated(tmp_path, name):
        assert (found.different, found.first, found.stopped) == (0, None, "")
        assert found.identical >= found.steps // 2 > 10


def test_the_recorded_jobs_match_their_names() -> None:
    acted = {
        name: "".join(
            acted for item in messages if isinstance(item, Telemetry) for acted in item.acted
        )
        for name, messages in played().items()
    }
    assert acted["paused"] == "pauseresumerelease"
    assert acted["stopped and let go"] == "stoprelease"
    assert acted["stopped free"] == "stop"
    for name in ("tripped free", "tripped held"):
        assert any(isinstance(item, RequestLog) and item.trip for item in played()[name])
        assert any(isinstance(item, Estimate) and item.tripped for item in played()[name])


def test_a_replay_uses_the_state_carried_into_the_epoch() -> None:
    messages = [
        replace(item, state_snapshot=Document("")) if isinstance(item, RequestLog) else item
        for item in played()["after a grip"]
    ]
    found = replay(plugins.load(plugins.SERVICES, "estimator"), RIG, messages)
    assert found.first is not None
    assert (found.first.seq, found.different) == (0, found.steps)


def test_a_record_without_its_arming_is_reported(tmp_path: Path) -> None:
    messages: list[Message] = [
        item for item in played()["grip"] if not isinstance(item, RequestLog)
    ]
    recording = recorded(tmp_path, RIG, messages, 1)
    for name in STEPS:
        found = replay(plugins.load(plugins.SERVICES, name), RIG, recorded_epoch(recording))
        assert (found.steps, found.same) == (0, False)
        assert "its arming is not in the record" in found.stopped


def test_a_record_with_a_gap_is_reproduced_up_to_the_gap() -> None:
    messages = [
        item
        for item in played()["grip"]
        if not (isinstance(item, Position | Estimate) and item.seq == 30)
    ]
    found = [replay(plugins.load(plugins.SERVICES, name), RIG, messages) for name in STEPS]
    assert [one.stopped for one in found] == [
        "position 30 is not in the record",
        "estimate 30 is not in the record",
        "position 30 is not in the record",
    ]
    assert all(one.different == 0 for one in found)
    assert [one.steps for one in found] == [30, 30, 60]


def test_a_missing_output_is_a_difference() -> None:
    messages = list(played()["grip"])
    odd = next(item for item in messages if isinstance(item, Estimate) and item.seq == 12)
    found = replay(plugins.load(plugins.SERVICES, "estimator"), RIG, [*messages, odd])
    assert found.first == Difference("estimate", 12, "", "said", None)
