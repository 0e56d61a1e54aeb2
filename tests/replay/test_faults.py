"""Grips with a faulty instrument: the replay also repeats the actuator's reaction."""

import pytest

from pincette.core import plugins
from pincette.core.faults import Cause
from pincette.core.messages import Message, RequestLog
from pincette.engine.replay.service_alone import replay
from pincette.engine.replay.steps import STEPS
from tests.support.rigs import Tree
from tests.support.scripted import T, a_rig, play

APPROACH_S, HOLD_S = 20 * T, 110 * T
FAULTS: dict[str, Tree] = {
    "garbage": {"at_s": APPROACH_S, "target": "sensor", "what": "garbage", "for_s": 2 * T},
    "blind": {"at_s": HOLD_S, "target": "sensor", "what": "off"},
    "stuck": {"at_s": APPROACH_S, "target": "sensor", "what": "stuck"},
    "intermittent": {"at_s": 0.0, "target": "sensor", "what": "intermittent", "value": 0.05},
    "no output, free": {"at_s": APPROACH_S, "target": "output", "what": "off"},
    "no output, held": {"at_s": HOLD_S, "target": "output", "what": "off"},
    "part lost": {"at_s": HOLD_S, "target": "part", "what": "lose"},
}


@pytest.mark.parametrize("name", FAULTS)
def test_replaying_a_failed_grip_reproduces_it(name: str) -> None:
    fault = FAULTS[name]
    played = play(fault)
    of_epoch: list[Message] = [
        item for item in played.messages if not isinstance(item, RequestLog) or item.epoch
    ]
    if fault["target"] == "output":
        assert played.trip is not None
        assert played.trip.cause == Cause.DEVICE
    for one in STEPS:
        found = replay(plugins.load(plugins.SERVICES, one), a_rig(fault), of_epoch)
        assert (found.different, found.first, found.stopped) == (0, None, "")
        assert found.identical > 20
