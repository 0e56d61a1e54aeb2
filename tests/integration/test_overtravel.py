"""An arm that moves further than its assumed gain predicts: the free motion is reduced
automatically.

The voltages of the plan are played on the plant alone, as the loop would play them.
"""

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.control.planning.program import Program
from pincette.control.planning.segments import paths_of
from pincette_study.open_loop import Motion, drive, peak_to_peak
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.kinds.calibrate.free_response import moves_less
from pincette_supervisor.kinds.calibrate.requests import FreeResponseRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Planned, Run
from tests.support.twenty_rigs import unknown_rig

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
BEYOND = (9, 26)
"""Seeds of rigs with relays whose arms leave their lowest position at 1.1 V below rest or less."""


def planned(rig: RigFile, request: JobRequest) -> Planned:
    found = plan_job(request, rig)
    assert found.plan.violations == []
    return found


def voltages(program: Program, period_s: float) -> list[float]:
    found = [0.0]
    for segment in program.segments:
        ticks = range(1, round((segment.duration_s or 0.0) / period_s) + 1)
        paths, last_V = paths_of(segment), found[-1]
        found += [paths[0].at(tick * period_s) if paths else last_V for tick in ticks]
    return found


def table_of(x_um: list[float], voltage_V: list[float]) -> dict[str, list[Any]]:
    """Return the columns of a record that a calibration of a free arm uses."""
    count = len(x_um)
    return {
        "seq": list(range(count)),
        "phase": [""] * count,
        "position_valid": [True] * count,
        "x_um": x_um,
        "voltage_V": voltage_V,
        "force_mN": [0.0] * count,
    }


def played(rig: RigFile, request: JobRequest) -> tuple[Run, Motion]:
    assert rig.simulation is not None
    plan = planned(rig, request)
    free = rig.simulation.model_copy(update={"bead": False})
    motion = drive(free, voltages(plan.program, rig.rig.period_s), rig.rig.period_s)
    put_out_V = np.append(motion.voltage_V[1:], motion.voltage_V[-1])
    table = table_of(motion.x_um.tolist(), put_out_V.tolist())
    return Run(rig, plan, table), motion


@pytest.mark.parametrize("seed", BEYOND)
def test_the_next_attempt_stays_within_the_position_limits(seed: int) -> None:
    rig = unknown_rig("slow", seed, relays=True)
    request = REQUEST.validate_python({"kind": "calibrate", "calibration": "free_response"})
    run, motion = played(rig, request)
    assert float(motion.true_x_um.min()) < rig.limits.position_min_um
    assert isinstance(request, FreeResponseRequest)
    less = moves_less(request, run)
    assert less is not None
    following, _ = less
    again, motion = played(rig, following)
    assert rig.limits.position_min_um < float(motion.true_x_um.min())
    assert float(motion.true_x_um.max()) < rig.limits.position_max_um
    cycles = next(one for one in again.planned.program.segments if one.phase == "cycles")
    (path,) = paths_of(cycles)
    assert path.amplitude == pytest.approx(1.0)
    assert peak_to_peak(motion.voltage_V) > 3.0


def test_a_motion_that_stayed_within_the_limits_is_not_reduced_below_two_volts() -> None:
    rig = unknown_rig("slow", BEYOND[0], relays=True)
    request = REQUEST.validate_python(
        {"kind": "calibrate", "calibration": "free_response", "least_V": -0.1, "most_V": 2.0}
    )
    plan = planned(rig, request)
    put_out_V = voltages(plan.program, rig.rig.period_s)
    table = table_of([200.0] * len(put_out_V), put_out_V)
    assert isinstance(request, FreeResponseRequest)
    assert moves_less(request, Run(rig, plan, table)) is None
