"""Calibrations are replayed like other jobs: with the actions of a person, and with a played
wave."""

from pathlib import Path
from typing import Any

import pytest

from pincette.config import read_rig
from pincette.core import plugins
from pincette.core.messages import Burst, Command, Message, RequestLog
from pincette.engine.composed import ComposedLoop
from pincette.engine.replay.service_alone import replay
from pincette.engine.replay.steps import STEPS
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.calibrating import REQUEST, Bystander, opened_benches
from tests.support.rigs import DEMO, KILOHERTZ, Tree, at_own_ports

AWAY: Tree = {"rig": {"time": "lockstep"}, "simulation": {"bead": False}}
SLOW, FAST = DEMO, DEMO.parent / "fast.toml"
SWEPT = "frequency_response"


@pytest.mark.parametrize(
    ("path", "wishes"),
    [
        (SLOW, {"calibration": "compliance", "weights_mN": [0.0, 5.0, 10.0, 20.0]}),
        (SLOW, {"calibration": "contact_stiffness"}),
        (FAST, {"calibration": SWEPT, "duration_s": 2.0}),
        (KILOHERTZ, {"calibration": "output_timing"}),
    ],
    ids=["hands", "press", "sweep", "bursts"],
)
def test_replaying_a_calibration_reproduces_it(path: Path, wishes: dict[str, Any]) -> None:
    changes = {} if wishes["calibration"] == "contact_stiffness" else AWAY
    rig = at_own_ports(read_rig(path), {"rig": {"time": "lockstep"}, **changes})
    planned = plan_job(REQUEST.validate_python({"kind": "calibrate", **wishes}), rig)
    with opened_benches() as benches:
        loop = ComposedLoop(rig)
        Bystander(loop, benches[-1], planned)
        played = loop.play(planned.program)
    selected: list[Message] = [
        item for item in played if not isinstance(item, RequestLog) or item.epoch
    ]
    swept = any(isinstance(item, Command) and item.sweep for item in selected)
    assert swept == (wishes["calibration"] == SWEPT)
    assert swept == any(isinstance(item, Burst) for item in selected)
    for one in STEPS:
        found = replay(plugins.load(plugins.SERVICES, one), rig, selected)
        assert (found.different, found.first, found.stopped) == (0, None, "")
        assert found.identical > 20
