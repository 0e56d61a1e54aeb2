"""What services work out ahead, and what they leave until their output is out, change no number."""

from dataclasses import replace
from functools import cache
from typing import Any

import pytest

from pincette.core.codec import encode
from pincette.core.messages import Message
from pincette.core.service import AnyService
from pincette.core.topics import LOOP
from pincette_supervisor.kinds.track import TrackJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.bench.hop.alone import Alone, recorded_grip
from tests.support.alone import recording
from tests.support.rigs import demo_rig

TRACK = TrackJobRequest(
    kind="track", shape="sinusoid", force_mean_mN=12.0, force_pp_mN=10.0, cycles=2, load_s=1.0
)


@cache
def played(kind: str) -> dict[str, Alone]:
    """Every service with the recording of a job of the demo rig."""
    if kind == "grip":
        return recorded_grip()
    rig = demo_rig({"simulation": {"truth": False}}, time="lockstep")
    program = plan_job(TRACK, rig).program
    recorded = recording(rig, program)
    return {name: Alone(name, rig, program, recorded) for name in LOOP}


def said(alone: Alone, service: AnyService) -> list[bytes]:
    """All that a service says to the recorded inputs, as it leaves."""
    found: list[bytes] = []

    def step(*arguments: Any) -> Any:
        after = service.step(*arguments)
        found.extend(encode(one) for one in after[1] if isinstance(one, Message))
        return after

    alone.begun(replace(service, step=step))()
    return found


@pytest.mark.parametrize("name", LOOP)
@pytest.mark.parametrize("kind", ["grip", "track"])
def test_without_it_every_message_is_the_same_to_the_last_bit(kind: str, name: str) -> None:
    alone = played(kind)[name]
    found = said(alone, alone.service)
    assert len(found) >= alone.ticks
    assert found == [encode(one) for one in alone.outputs[-len(found) :]]
    assert found == said(alone, replace(alone.service, ahead=None))
