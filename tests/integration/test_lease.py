"""The end of a lease in lockstep, where only tests use one: virtual time, reproducible bit by
bit."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from pincette.api.requests import JobRequest
from pincette.core import plugins
from pincette.core.faults import Acted, LeaseEnd
from pincette.core.messages import (
    Applied,
    GroundTruth,
    Lease,
    Message,
    RequestLog,
    Reset,
    Sample,
    Telemetry,
)
from pincette.core.topics import LOOP, RESET, TOPICS, Topic
from pincette.engine.arming import arm
from pincette.engine.composed import ComposedLoop
from pincette.engine.replay.service_alone import replay
from pincette_supervisor.jobs.lease import lease_end
from pincette_supervisor.kinds.calibrate.requests import ContactStiffnessRequest
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.replay.desk import recorded
from tests.support.grips import SHORT
from tests.support.rigs import demo_rig

RIG = demo_rig(SHORT, time="lockstep")
EPOCH, LENGTH_S = 7, 1.0
GRIP = GripJobRequest(kind="grip", hold_s=3.0)
Renew = Callable[[ComposedLoop, int], None]


def nobody(_loop: ComposedLoop, _seq: int) -> None:
    """Renew nothing."""


def played(
    length_s: float,
    renew: Renew = nobody,
    most: int = 1000,
    request: JobRequest = GRIP,
    then: LeaseEnd = LeaseEnd.STOP,
) -> tuple[Message, ...]:
    """Play a job of this many ticks under a lease; ``renew`` is called after every tick."""
    loop = ComposedLoop(RIG)
    received: list[Message] = []

    def take(_topic: Topic, message: Message) -> None:
        received.append(message)
        if isinstance(message, Applied) and message.seq >= 0:
            renew(loop, message.seq)

    for topic in TOPICS:
        loop.bus.subscribe(topic, take)
    loop.bus.call(RESET, Reset(acknowledge=True))
    program = plan_job(request, RIG).program
    lease = Lease(EPOCH, length_s, then)
    arm(loop.bus, program, epoch=EPOCH, digest=RIG.digest(), lease=lease)
    while loop.bus.pump():
        if sum(isinstance(message, Applied) for message in received) > most:
            break
    return tuple(
        item
        for item in received
        if not isinstance(item, Sample | RequestLog) or item.epoch == EPOCH
    )


@cache
def lost(length_s: float = LENGTH_S) -> tuple[Message, ...]:
    """A grip whose supervisor never sends a message."""
    return played(length_s)


def ended(messages: tuple[Message, ...]) -> list[RequestLog]:
    """Return the actions that the controller has requested of itself."""
    return [item for item in messages if isinstance(item, RequestLog) and item.action is not None]


def view(messages: tuple[Message, ...]) -> list[Telemetry]:
    return [item for item in messages if isinstance(item, Telemetry)]


def test_the_program_is_stopped_at_the_tick_at_which_its_lease_has_ended() -> None:
    (noted,) = ended(lost())
    assert noted.action is not None
    assert (noted.action.action, noted.service, noted.topic) == ("stop", "controller", "estimate")
    # Granted at 0 s; the program stops at the first sample after the limit.
    assert noted.seq == round(LENGTH_S / RIG.rig.period_s) + 1
    acted = [sample.seq for sample in view(lost()) if sample.acted == (Acted.LEASE, Acted.STOP)]
    assert acted == [noted.seq + 1]
    last = [item for item in lost() if isinstance(item, Applied)][-1]
    assert (last.final, last.state, last.part_held) == (True, "idle", False)


@pytest.mark.parametrize("length_s", [1.8, 9.0])
def test_a_calibration_that_presses_leaves_no_force_on_the_part(length_s: float) -> None:
    request = ContactStiffnessRequest(calibration="contact_stiffness")
    messages = played(length_s, most=3000, request=request, then=lease_end(request))
    (noted,) = ended(messages)
    before = [item for item in view(messages) if item.seq == noted.seq][-1]
    last = [item for item in messages if isinstance(item, Applied)][-1]
    assert (last.final, last.state, last.part_held) == (True, "idle", False), before.phase
    truth = [item for item in messages if isinstance(item, GroundTruth)][-1]
    assert truth.arms[0].force_mN == 0.0, before.phase
    assert {item.state for item in messages if isinstance(item, Applied)} == {"armed", "idle"}


@pytest.mark.parametrize("name", [name for name in LOOP if name != "sensor"])
def test_a_replay_repeats_the_end_of_a_lease(name: str, tmp_path: Path) -> None:
    kept = recorded(tmp_path / "job", RIG, list(lost()), EPOCH)
    service = plugins.load(plugins.SERVICES, name)
    findings = replay(service, RIG, kept.messages)
    assert findings.same, findings
    assert findings.identical > 50
