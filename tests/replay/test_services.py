"""One service, given a recorded run, publishes what it had published in that run."""

from functools import cache

import pytest

from pincette.config import read_rig
from pincette.core import plugins
from pincette.core.messages import Message
from pincette.core.topics import LOOP
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.alone import recording, service_alone
from tests.support.fast_output import fast_rig
from tests.support.rigs import KILOHERTZ, demo_rig

DEMO, FAST = demo_rig(time="lockstep"), read_rig(KILOHERTZ)
PARTS = fast_rig("three writes")
HELD = GripJobRequest(kind="grip", hold_s=4.0, load_s=1.0)
PROGRAMS = {
    "demo": (DEMO, plan_job(HELD, DEMO).program),
    "in parts": (PARTS, plan_job(HELD, PARTS).program),
    "1 kHz": (FAST, plan_job(GripJobRequest(kind="grip", hold_s=0.02), FAST).program),
}


@cache
def recorded(what: str) -> tuple[Message, ...]:
    """Return every message of a whole grip, in order."""
    return recording(*PROGRAMS[what])


@pytest.mark.parametrize("name", LOOP)
@pytest.mark.parametrize("what", PROGRAMS)
def test_a_service_is_reproduced_to_the_last_bit(what: str, name: str) -> None:
    rig, program = PROGRAMS[what]
    runner, published = service_alone(
        plugins.load(plugins.SERVICES, name), rig, program, recorded(what)
    )
    inputs = {item.topic.message for item in runner.service.inputs}
    kinds = {topic.message for topic in runner.service.outputs}

    def run() -> None:
        while (outputs := runner.fire(0.0)) is not None:
            published.extend(outputs)

    run()
    for message in recorded(what):
        if type(message) in inputs:
            runner.take(message, 0.0)
            run()
    expected = [message for message in recorded(what) if type(message) in kinds]
    assert len(expected) > 400
    selected = [message for message in published if type(message) in kinds]
    assert selected[-len(expected) :] == expected
