"""The law of short periods in the loop as it is: services and instruments' bytes, at 1 ms."""

from math import sqrt

import pytest
from msgspec.structs import replace

from pincette.config import Output, RigFile
from pincette.config.laws import law_definition
from pincette.core.messages import Estimate, GroundTruth, Message, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette.engine.timing_budget import Budget
from pincette_study.closed_loop import errors, tracked, tracking_plan
from tests.support.rigs import demo_rig

PERIOD_S, HZ, CYCLES = 0.001, 10.0, 6


@pytest.fixture(scope="module")
def rig() -> RigFile:
    """The demo rig with a fine output; in lockstep its serial bytes take no time."""
    changes = {
        "rig": {"period_s": PERIOD_S},
        "sensor": {"options": {"unit": "mm"}},
        "model": {"force_observer": "smooth", "output_delay_s": 0.00065},
        "limits": {"slew_V_per_s": 100.0},
        "grip": {"load_s": 0.3, "approach_um_per_s": 100.0, "seek_um_per_s": 20.0, "zero_s": 0.1},
        "simulation": {
            "actuation_delay_s": 0.00065,
            "output_lag_s": 0.0,
            "output_step_V": 20.0 / 65536.0,
            "sensor_step_um": 0.003,
            "substep_s": 0.00025,
        },
    }
    found = demo_rig(changes, time="lockstep")
    output = Output(driver="srs_dc205", url=found.output.url)
    return found.model_copy(update={"output": output})


@pytest.fixture(scope="module")
def published(rig: RigFile) -> list[Message]:
    plan = tracking_plan(rig, frequency_hz=HZ, cycles=CYCLES)
    law = law_definition("fpbsmic").settings("identified")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Budget, "fits", property(lambda _: True))
        return ComposedLoop(rig).play(replace(plan.program, laws=(law.spec(),)))


def test_a_path_of_10_hz_is_followed_in_position_and_force(
    rig: RigFile, published: list[Message]
) -> None:
    plan = tracking_plan(rig, frequency_hz=HZ, cycles=CYCLES)
    path = next(s.path for s in plan.program.segments if s.path is not None)
    found = errors(tracked(published, path, PERIOD_S))
    assert found.position_percent < 0.6
    # The demo rig has not been stroked: its first load shows what the model does not know of it.
    assert found.force_percent < 4.0
    told = [m for m in published if isinstance(m, Telemetry)]
    assert told[-1].outcome == "tracked"


def test_the_estimate_is_of_the_age_of_the_position(published: list[Message]) -> None:
    truths = [m for m in published if isinstance(m, GroundTruth)]
    forces = {m.seq - truths[0].seq: m.force_mN for m in truths}
    estimates = [m for m in published if isinstance(m, Estimate) and m.zero_age_s is not None]
    off = [m.force_mN - forces[m.seq] for m in estimates if m.seq in forces]
    assert sqrt(sum(value * value for value in off) / len(off)) < 1.0
