"""Jobs of a rig of two arms, whose outputs have different steps: their records are reproduced."""

from functools import cache
from pathlib import Path

import pytest

from pincette.config import RigFile
from pincette.core import plugins
from pincette.core.messages import Applied, Estimate, GroundTruth, Message, RequestLog, Telemetry
from pincette.engine.replay.recorded import recorded_epoch, recorded_rig
from pincette.engine.replay.service_alone import replay
from pincette.engine.replay.steps import STEPS
from tests.replay.desk import Desk, Watch, at, nobody, recorded
from tests.support.two_arms import play, short_grip, two_arm_rig

COARSE_V = 0.004
"""Step of the second output, in V, which is not a multiple of the first output's step."""
RIG = two_arm_rig(
    {"safety": {"freeze_s": 0.2}},
    {"second": {"output": {"step_V": COARSE_V}}},
    {"simulation": {"second": {"output_step_V": COARSE_V}}},
)


def stop_and_let_go(desk: Desk, message: Telemetry | Applied) -> None:
    """Stop in the hold, which keeps the part, and release it a little later."""
    if not isinstance(message, Telemetry) or not message.playing or message.phase != "hold":
        return
    if message.segment_tick == 10:
        desk.act("stop" if message.segment >= 0 else "release")


JOBS: tuple[tuple[str, Watch], ...] = (
    ("grip", nobody),
    ("after a grip", nobody),
    ("stopped and let go", stop_and_let_go),
    ("tripped free", at("approach", 9, Desk.trip)),
    ("tripped held", at("hold", 10, Desk.trip)),
)


@cache
def played() -> dict[str, tuple[Message, ...]]:
    """Messages of each job, in the order in which the jobs were played."""
    desk = Desk(RIG)
    found: dict[str, tuple[Message, ...]] = {}
    for epoch, (name, watch) in enumerate(JOBS, start=1):
        found[name] = tuple(desk.play(short_grip(RIG, 0.4), epoch, watch))
        desk.reset()
    return found


@pytest.mark.parametrize("name", [name for name, _ in JOBS])
def test_a_record_of_two_arms_is_reproduced_bit_for_bit(tmp_path: Path, name: str) -> None:
    epoch = 1 + list(played()).index(name)
    recording = recorded(tmp_path / name, RIG, list(played()[name]), epoch)
    rig = recorded_rig(recording, tmp_path)
    for service in STEPS:
        found = replay(plugins.load(plugins.SERVICES, service), rig, recorded_epoch(recording))
        assert (found.different, found.first, found.stopped) == (0, None, "")
        assert found.identical >= found.steps // 2 > 10


def test_the_state_that_both_arms_carry_into_an_epoch_is_recorded() -> None:
    snapshots = {
        item.service: item.state_snapshot
        for item in played()["after a grip"]
        if isinstance(item, RequestLog) and item.arm is not None
    }
    assert '"arms":[{' in snapshots["estimator"]
    assert '"memories":[{' in snapshots["controller"]
    assert '"arms":[{' in snapshots["actuator"]


def of_second(rig: RigFile) -> tuple[list[float], list[float], list[float]]:
    """Return voltages of the second arm: commanded, applied, and used by its estimator."""
    messages, _ = play(changes=rig.model_dump(mode="json", include={"second", "simulation"}))
    by_seq = {item.seq: item for item in messages if isinstance(item, Applied)}
    seqs = [seq for seq, item in sorted(by_seq.items()) if item.answered]
    truths = [item for item in messages if isinstance(item, GroundTruth)]
    estimates = {item.seq: item for item in messages if isinstance(item, Estimate)}
    applied = [by_seq[seq].arms[1] for seq in seqs]
    true = [item.arms[1] for item in truths[-len(seqs) :]]
    followed = [estimates[seq + 1].arms[1] for seq in seqs if seq + 1 in estimates]
    return (
        [one.voltage_V for one in applied],
        [one.voltage_V for one in true],
        [one.applied_V for one in followed],
    )


def test_the_second_output_uses_multiples_of_its_own_step() -> None:
    told_V, true_V, followed_V = of_second(RIG)
    assert len(told_V) > 100
    for voltage_V in (*told_V, *true_V, *followed_V):
        assert voltage_V == round(voltage_V / COARSE_V) * COARSE_V
    assert set(followed_V) <= set(told_V)
    assert len(set(told_V)) > 50
