"""If one cause of errors is much larger than all others, the result of a job names it."""

from functools import cache
from math import sqrt

import pytest

from pincette.api.results import ErrorSources
from pincette.config import RigFile
from pincette.control.laws.error_sources import CAUSES
from pincette.control.record import replace
from pincette.engine.composed import ComposedLoop
from pincette.records.columns import columns
from pincette_supervisor.kinds.grip import GripJobRequest, GripResult
from pincette_supervisor.kinds.track import TrackJobRequest, TrackResult
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Evaluation, Run, functions_of, kind_of
from tests.support.rigs import Tree, demo_rig

TRACK = TrackJobRequest(
    kind="track",
    shape="sinusoid",
    force_mean_mN=12.0,
    force_pp_mN=16.0,
    frequency_hz=0.5,
    cycles=4,
    load_s=1.0,
)
SLEW: Tree = {"limits": {"slew_V_per_s": 50.0}}
RELAYS: Tree = {
    "simulation": {
        "hysteresis": None,
        "relays": {"loop_share": 0.15, "full_drive_V": 2.5, "centre_V": 1.0},
    }
}
"""An arm of another hysteresis class than the one to which the rig's model was fitted."""


def played(
    request: TrackJobRequest | GripJobRequest, rig: RigFile, *, on_planned_line: bool = False
) -> Evaluation:
    planned = plan_job(request, rig)
    program = planned.program
    if on_planned_line:
        program = replace(program, contact_line="planned")
    table = columns(ComposedLoop(rig).play(program), rig.rig.period_s)
    return functions_of(kind_of(request)).evaluate(Run(rig, planned, table))


def sources(found: Evaluation) -> ErrorSources:
    result = found.result
    assert isinstance(result, TrackResult | GripResult)
    assert result.error_sources is not None
    print(result.error_sources)
    return result.error_sources


@cache
def plain() -> Evaluation:
    return played(TRACK, demo_rig(SLEW, time="lockstep"))


def test_the_errors_of_a_good_rig_equal_the_noise_of_its_sensor() -> None:
    found = sources(plain())
    assert found.position_um.largest == "noise"
    assert "better sensor" in found.position_um.to_do
    # Noise that the default gains cause from 31 nm of sensor noise and the sensor's step.
    assert found.position_um.noise == pytest.approx(1.15 * 0.031, rel=0.2)


def test_the_expected_true_force_agrees_with_the_actual_one() -> None:
    result = plain().result
    assert isinstance(result, TrackResult)
    assert result.true_force_mN is not None
    assert 0.4 < sources(plain()).force_mN.total / result.true_force_mN.rmse < 3.0


@pytest.mark.parametrize(("frequency_hz", "arm"), [(0.5, RELAYS), (5.0, {})])
def test_the_squares_of_the_error_sources_add_up_to_the_squared_error(
    frequency_hz: float, arm: Tree
) -> None:
    rig = demo_rig(SLEW | arm, time="lockstep")
    cycles = {0.5: 4, 5.0: 20}[frequency_hz]
    path = TRACK.model_copy(update={"frequency_hz": frequency_hz, "cycles": cycles})
    found = sources(played(path, rig)).position_um
    added_um = sqrt(sum(getattr(found, cause) ** 2 for cause in CAUSES))
    print(frequency_hz, added_um / found.total)
    assert 0.95 < added_um / found.total < 1.1


def test_a_sensor_noisier_than_it_states_is_found() -> None:
    rig = demo_rig(SLEW | {"simulation": {"sensor_noise_um": 0.06}}, time="lockstep")
    found = sources(played(TRACK, rig))
    assert found.position_um.largest == "noise"
    assert "calibrate noise" in found.position_um.to_do
    assert found.position_um.noise == pytest.approx(1.15 * 0.06, rel=0.2)


def test_on_a_fast_path_lag_is_an_error_source() -> None:
    rig = demo_rig(SLEW, time="lockstep")
    fast = TRACK.model_copy(update={"frequency_hz": 5.0, "cycles": 20})
    found = sources(played(fast, rig))
    assert found.position_um.largest == "lag"
    assert "slowly" in found.position_um.to_do
    assert found.position_um.lag > 2.0 * sources(plain()).position_um.lag


def test_a_poorly_known_free_response_is_attributed_to_the_response() -> None:
    rig = demo_rig(SLEW, time="lockstep")
    assert rig.model.free_response is not None
    poor = rig.model.free_response.model_copy(
        update={"residual_um": 0.4, "error_ways_V": (), "errors_um": ()}
    )
    model = rig.model.model_copy(update={"free_response": poor})
    rig = rig.model_copy(update={"model": model})
    found = sources(played(TRACK, rig))
    assert found.force_mN.largest == "response"
    assert "residual calibration" in found.force_mN.to_do


def test_a_part_of_another_stiffness_is_attributed_to_the_contact_line() -> None:
    softer = SLEW | {"simulation": {"environment_stiffness_mN_per_um": 1.7}}
    found = sources(played(TRACK, demo_rig(softer, time="lockstep"), on_planned_line=True))
    assert found.position_um.largest == found.force_mN.largest == "contact_line"
    assert "contact line" in found.force_mN.to_do


def test_a_limit_that_acts_is_named() -> None:
    rig = demo_rig({"limits": {"slew_V_per_s": 6.0}}, time="lockstep")
    fast = TRACK.model_copy(update={"frequency_hz": 5.0, "cycles": 10})
    found = sources(played(fast, rig))
    assert found.position_um.largest == "limits"
    assert "limit" in found.position_um.to_do


def test_a_grip_has_error_sources_and_one_without_a_hold_has_none() -> None:
    rig = demo_rig(time="lockstep")
    found = sources(played(GripJobRequest(kind="grip", hold_s=1.0), rig))
    assert found.position_um.lag < 0.01
    assert found.position_um.limits == 0.0
    assert 0.0 < found.force_mN.total < 1.5
    away = demo_rig({"simulation": {"bead": False}}, time="lockstep")
    result = played(GripJobRequest(kind="grip", hold_s=1.0), away).result
    assert isinstance(result, GripResult)
    assert result.outcome == "no_contact"
    assert result.error_sources is None
