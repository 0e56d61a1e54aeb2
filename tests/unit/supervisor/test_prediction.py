"""The prediction of a plan, compared with the motion of the whole loop."""

from functools import cache
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from pincette.api.calibrations import CalibrationPlan
from pincette.api.predictions import Margin
from pincette.api.requests import JobRequest
from pincette.config import RigFile, read_rig
from pincette.core.messages import Applied, GroundTruth, Message, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning import dry_run
from pincette_supervisor.planning.dry_run import stated_instruments
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.planning.prediction import CURVE_POINTS, played, with_prediction
from pincette_supervisor.plugin import Planned, Present
from tests.support.rigs import DEMO, Tree, at_own_ports, demo_rig

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
INSTRUMENTS = stated_instruments(read_rig(DEMO))
STRAIGHT: Tree = {
    "model": {"free_response": None},
    "output": {"step_V": 0.0},
    "simulation": {
        "piezo_um_per_V": 19.0,
        "hysteresis": {"A_over_d": 0.0},
        "creep_per_decade": 0.0,
        "sensor_noise_um": 0.0,
        "sensor_step_um": 1e-6,
        "output_step_V": 1e-6,
        "output_lag_s": INSTRUMENTS.lag_s,
        "actuation_delay_s": INSTRUMENTS.delay_s,
        "bead_contact_um": 30.0,
        "environment_stiffness_mN_per_um": 2.17,
    },
}
"""A rig whose true parameters are those of its model."""


def plan(rig: RigFile, present: Present | None = None, **wishes: Any) -> Planned:
    return plan_job(REQUEST.validate_python(wishes), rig, present)


def predicted(rig: RigFile, **wishes: Any) -> Planned:
    planned = plan(rig, **wishes)
    return with_prediction(planned, played(planned))


@cache
def straight() -> RigFile:
    return demo_rig(STRAIGHT, time="lockstep")


@cache
def demo() -> RigFile:
    return demo_rig(time="lockstep")


def truths(messages: list[Message]) -> dict[int, GroundTruth]:
    return {item.seq: item for item in messages if isinstance(item, GroundTruth)}


def voltages(messages: list[Message]) -> dict[int, float]:
    return {item.seq: item.arms[0].voltage_V for item in messages if isinstance(item, Applied)}


def last_outcome(messages: list[Message]) -> str:
    return [item for item in messages if isinstance(item, Telemetry)][-1].outcome


@pytest.mark.parametrize("kind", ["grip", "track"])
def test_a_rig_that_equals_its_model_moves_as_predicted(kind: str) -> None:
    planned = plan(straight(), kind=kind)
    found = played(planned)
    messages = ComposedLoop(straight()).play(planned.program)
    true, applied, samples = truths(messages), voltages(messages), found.samples
    assert last_outcome(messages) == found.outcome
    assert len(samples.t_s) == len(true)
    # The output takes its voltage as a text of millivolts: 1 mV is 0.019 µm.
    for seq, sample in true.items():
        assert samples.x_um[seq] == pytest.approx(sample.arms[0].x_um, abs=0.03)
        assert samples.force_mN[seq] == pytest.approx(sample.arms[0].force_mN, abs=0.05)
        assert samples.voltage_V[seq] == pytest.approx(applied[seq], abs=0.002)


@pytest.mark.parametrize("kind", ["grip", "track"])
def test_the_demo_rig_is_close_to_the_prediction(kind: str) -> None:
    planned = plan(demo(), kind=kind)
    found = played(planned)
    messages = ComposedLoop(demo()).play(planned.program)
    true = truths(messages).values()
    assert last_outcome(messages) == found.outcome
    # Its part lies 1.2 µm further and is 3 % softer than the rig file says.
    peak_mN = max(sample.arms[0].force_mN for sample in true)
    assert max(found.samples.force_mN) == pytest.approx(peak_mN, abs=0.6)
    peak_V = max(voltages(messages).values())
    assert max(found.samples.voltage_V) == pytest.approx(peak_V, abs=0.08)


def test_hidden_values_of_a_simulated_rig_are_not_used() -> None:
    other = demo_rig({"simulation": {"piezo_um_per_V": 30.0, "bead": False}}, time="lockstep")
    real = demo().model_copy(update={"simulation": None})
    wanted = played(plan(demo(), kind="grip")).samples
    for rig in (other, real):
        assert played(plan(rig, kind="grip")).samples == wanted


def test_hysteresis_and_creep_are_predicted_where_they_were_identified() -> None:
    planned = predicted(demo(), kind="grip")
    plain = predicted(straight(), kind="grip")
    prediction, straight_one = planned.plan.prediction, plain.plan.prediction
    assert prediction is not None
    assert straight_one is not None
    assert prediction.curves.voltage_V[-1] == pytest.approx(-0.285, abs=0.02)
    assert straight_one.curves.voltage_V[-1] == pytest.approx(0.0, abs=0.005)
    assert "as identified" in prediction.assumptions[1]
    assert "straight line" in straight_one.assumptions[1]


def test_curves_peaks_and_margins_of_a_prediction_agree() -> None:
    planned = plan(demo(), kind="track")
    found = played(planned)
    samples, limits = found.samples, demo().limits
    prediction = with_prediction(planned, found).plan.prediction
    assert prediction is not None
    assert (prediction.outcome, prediction.succeeds, prediction.complete) == ("tracked", True, True)
    lengths = {len(column) for column in prediction.curves.model_dump().values()}
    assert len(lengths) == 1
    assert 100 < lengths.pop() <= CURVE_POINTS
    assert prediction.peaks.force_max_mN == max(samples.force_mN)
    force = margin(prediction.margins, "force", limits.force_max_mN)
    assert force.nearest == max(samples.force_mN)
    assert force.distance == pytest.approx(limits.force_max_mN - force.nearest)
    assert force.phase == "track"
    low = margin(prediction.margins, "voltage", limits.voltage_min_V)
    assert low.distance == pytest.approx(min(samples.voltage_V) - limits.voltage_min_V, abs=1e-3)
    assert all(item.distance > 0.0 for item in prediction.margins)
    ends = [phase.start_s + phase.duration_s for phase in prediction.phases]
    assert ends[:-1] == pytest.approx([phase.start_s for phase in prediction.phases[1:]])
    assert ends[-1] == pytest.approx(prediction.duration_s)


def margin(margins: list[Margin], quantity: str, limit: float) -> Margin:
    return next(item for item in margins if (item.quantity, item.limit) == (quantity, limit))


def test_the_sliding_band_is_reported_if_the_law_has_one() -> None:
    without = predicted(straight(), kind="grip").plan.prediction
    within = predicted(straight(), kind="grip", gains={"K_S": 1.0}).plan.prediction
    assert without is not None
    assert within is not None
    assert not [item for item in without.margins if item.quantity == "sliding"]
    (band,) = (item for item in within.margins if item.quantity == "sliding")
    assert band.limit > 0.0
    assert band.distance == pytest.approx(band.limit - band.nearest)


def test_a_limit_that_is_exceeded_only_in_the_predicted_motion_makes_the_plan_infeasible() -> None:
    rig = at_own_ports(straight(), {"limits": {"force_max_mN": 20.1}})
    assert plan(rig, kind="grip", force_mN=20.0).plan.feasible
    after = predicted(rig, kind="grip", force_mN=20.0).plan
    assert not after.feasible
    assert after.prediction is not None
    # Its guard sees the estimate, which stays below.
    assert after.prediction.outcome == "gripped"
    (broken,) = after.prediction.violations
    assert after.violations == [broken]
    assert (broken.quantity, broken.pointer, broken.limit) == ("force", "/force_mN", 20.1)
    assert 20.1 < broken.value < 20.3
    assert f"from {broken.at_s:.2f} s" in broken.message
    assert "mN" in broken.message


def test_a_voltage_that_the_actuator_would_limit_is_a_violation() -> None:
    rig = at_own_ports(straight(), {"limits": {"voltage_max_V": 2.55}})
    after = predicted(rig, kind="grip").plan
    assert after.prediction is not None
    assert {item.quantity for item in after.prediction.violations} == {"voltage"}
    assert after.prediction.peaks.voltage_max_V <= 2.55


def test_an_endless_hold_is_predicted_with_an_early_release() -> None:
    prediction = predicted(straight(), kind="grip", until_released=True).plan.prediction
    assert prediction is not None
    assert (prediction.outcome, prediction.succeeds) == ("released", True)
    assert prediction.complete
    hold = next(phase for phase in prediction.phases if phase.phase == "hold")
    assert hold.duration_s == pytest.approx(dry_run.ENDLESS_S, abs=0.05)


def test_a_long_plan_is_predicted_up_to_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dry_run, "LONGEST_S", 8.0)
    prediction = predicted(straight(), kind="grip", hold_s=3000.0).plan.prediction
    assert prediction is not None
    assert not prediction.complete
    assert not prediction.succeeds
    assert prediction.duration_s == pytest.approx(8.0)
    assert "8 s" in prediction.cut


def test_the_number_of_predicted_samples_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dry_run, "LONGEST_SAMPLES", 150)
    prediction = predicted(straight(), kind="grip").plan.prediction
    assert prediction is not None
    assert len(prediction.curves.t_s) == 150
    assert prediction.cut == "3 s can be predicted at most"


def test_a_move_starts_at_the_present_position_of_the_arm() -> None:
    planned = plan(straight(), Present(1.0, 19.0, False), kind="move", to_um=35.0)
    found = played(planned)
    assert found.samples.voltage_V[0] == pytest.approx(1.0, abs=0.01)
    assert found.samples.x_um[0] == pytest.approx(19.0)
    assert found.samples.x_um[-1] == pytest.approx(35.0, abs=0.05)
    assert max(found.samples.force_mN) == 0.0
    assert found.outcome == "moved"


def test_the_prediction_of_a_calibration_includes_its_weights() -> None:
    planned = plan(
        straight(), kind="calibrate", calibration="compliance", weights_mN=[0.0, 5.0, 10.0]
    )
    samples = played(planned).samples
    s_p = straight().model.compliance_um_per_mN
    resting = dict(zip(samples.phase, samples.x_um, strict=True))
    assert resting["measure 3"] == pytest.approx(-10.0 * s_p, abs=1e-3)
    after = with_prediction(planned, played(planned)).plan
    assert isinstance(after, CalibrationPlan)
    assert after.prediction is not None
    assert after.prediction.outcome == "moved"


def test_a_swept_sine_is_not_predicted() -> None:
    rig = read_rig(Path(DEMO).with_name("fast.toml"))
    planned = plan(rig, kind="calibrate", calibration="frequency_response")
    prediction = with_prediction(planned, played(planned)).plan.prediction
    assert prediction is not None
    assert prediction.cut == dry_run.SWEEP
    assert not prediction.complete


def test_a_driver_without_stated_timing_is_assumed_ideal() -> None:
    unknown = straight().model_copy(
        update={"output": straight().output.model_copy(update={"driver": "nobody_knows"})}
    )
    assert stated_instruments(unknown).delay_s == 0.0
    assert INSTRUMENTS.lag_s == pytest.approx(0.01 / 3.0)
    assert 0.003 < INSTRUMENTS.delay_s < 0.01
