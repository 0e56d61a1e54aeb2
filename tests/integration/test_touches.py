"""Contact with a part where none is expected, by whole loops on randomly drawn rigs of both
classes.

The true force stays below the smallest detectable contact plus a margin: the kink needs two steps
of 1.2 µm and three samples, in which 60 µm/s, the fastest of free motions, add 1.3 mN each.
"""

from typing import Any

import pytest

from pincette.config import RigFile
from pincette.core.messages import Applied, GroundTruth, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.calibrating import REQUEST
from tests.support.rigs import demo_rig
from tests.support.twenty_rigs import unknown_rig

MOST_MN = 10.0
JOBS: dict[str, dict[str, Any]] = {
    "grip": {"kind": "grip", "force_mN": 5.0},
    "move": {"kind": "move", "to_um": 35.0, "zero": False},
    "free_response": {"kind": "calibrate", "calibration": "free_response"},
    "contact_stiffness": {"kind": "calibrate", "calibration": "contact_stiffness"},
    "frequency_response": {"kind": "calibrate", "calibration": "frequency_response"},
}


def with_part(rig: RigFile, at_um: float | None) -> RigFile:
    """Return the rig with a part at a position, or without one."""
    assert rig.simulation is not None
    update: dict[str, Any] = {"bead": at_um is not None}
    if at_um is not None:
        update["bead_contact_um"] = at_um
    return rig.model_copy(update={"simulation": rig.simulation.model_copy(update=update)})


def played(rig: RigFile, job: str) -> tuple[Telemetry, float, float]:
    """Return the controller's last status, the highest true force, and the last one."""
    program = plan_job(REQUEST.validate_python(JOBS[job]), rig).program
    published = ComposedLoop(rig).play(program)
    assert not any(m.cause for m in published if isinstance(m, Applied))
    forces_mN = [m.arms[0].force_mN for m in published if isinstance(m, GroundTruth)]
    return [m for m in published if isinstance(m, Telemetry)][-1], max(forces_mN), forces_mN[-1]


@pytest.mark.parametrize(
    ("job", "relays"),
    [("grip", False), ("move", True), ("free_response", False), ("frequency_response", True)],
)
def test_an_uncalibrated_rig_detects_a_part_in_the_way(job: str, relays: bool) -> None:
    rig = unknown_rig("fast", 3, relays=relays)
    seen, most_mN, last_mN = played(with_part(rig, 20.0), job)
    print(job, relays, most_mN, seen.touch_x_um, seen.touch_mN)
    assert seen.outcome == "contact"
    assert 0.1 < most_mN < MOST_MN
    assert last_mN == 0.0
    assert seen.touch_x_um == pytest.approx(20.0, abs=3.0)
    assert seen.touch_mN is not None
    assert seen.touch_mN >= rig.grip.contact_force_mN


@pytest.mark.parametrize("job", ["grip", "move", "free_response", "contact_stiffness"])
def test_a_calibrated_rig_detects_a_part_in_the_way(job: str) -> None:
    """The part is at 22.5 µm instead of the planned 30: 5 mN were requested, and 34 mN were
    reached."""
    seen, most_mN, last_mN = played(with_part(demo_rig(time="lockstep"), 22.5), job)
    print(job, most_mN, seen.touch_x_um, seen.touch_mN)
    assert seen.outcome == "contact"
    assert most_mN < MOST_MN
    assert last_mN == 0.0
    assert seen.touch_x_um == pytest.approx(22.5, abs=3.0)


@pytest.mark.parametrize(
    ("job", "relays"), [("free_response", True), ("move", True), ("frequency_response", False)]
)
def test_a_free_motion_runs_to_its_end(job: str, relays: bool) -> None:
    rig = unknown_rig("fast", 3, relays=relays)
    seen, most_mN, _ = played(with_part(rig, None), job)
    assert (seen.outcome, most_mN, seen.touch_mN) == ("moved", 0.0, None)
