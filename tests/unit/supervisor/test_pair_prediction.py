"""Plans of two arms played on the model in use before anything moves."""

from typing import Any

import pytest
from pydantic import TypeAdapter

from pincette.api.pairs import PairPlan, PairPrediction
from pincette.api.requests import JobRequest
from pincette.config import read_rig
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.planning.prediction import played, with_prediction
from pincette_supervisor.plugin import Present
from tests.support.two_arms import TWO_ARMS

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
RIG = read_rig(TWO_ARMS)


def predicted(body: dict[str, Any], present: Present | None = None) -> PairPlan:
    planned = plan_job(REQUEST.validate_python(body), RIG, present)
    plan = with_prediction(planned, played(planned)).plan
    assert isinstance(plan, PairPlan)
    return plan


def prediction_of(plan: PairPlan) -> PairPrediction:
    assert plan.prediction is not None
    return plan.prediction


@pytest.mark.parametrize(
    ("body", "outcome"),
    [
        ({"kind": "grip", "hold_s": 1.0, "place_um": 4.0}, "gripped"),
        ({"kind": "grip", "centre": True, "hold_s": 1.0}, "gripped"),
    ],
)
def test_a_grip_is_predicted_with_force_place_and_uncertainty(
    body: dict[str, Any], outcome: str
) -> None:
    plan = predicted(body)
    found = prediction_of(plan)
    assert (found.outcome, found.succeeds, found.complete) == (outcome, True, True), found.cut
    figures = found.figures
    assert figures is not None
    assert figures.force_held_mN == pytest.approx(15.0, abs=0.1)
    assert figures.held_place_um == pytest.approx(body.get("place_um", -0.25), abs=0.05)
    assert figures.force_uncertainty_mN is not None
    assert 0.1 < figures.force_uncertainty_mN < 1.0
    assert figures.true_force_mN is None
    curves = found.curves
    assert len({len(getattr(curves, name)) for name in type(curves).model_fields}) == 1
    assert {margin.arm for margin in found.margins} == {1, 2}
    assert any("arm 2" in words for words in found.assumptions)


def test_predicted_and_simulated_paths_agree() -> None:
    body = {
        "kind": "track",
        "place": {"pp_um": 8.0, "frequency_hz": 0.5, "cycles": 2},
        "force": {"mean_mN": 15.0, "pp_mN": 10.0, "frequency_hz": 0.5, "cycles": 2},
    }
    figures = prediction_of(predicted(body)).figures
    assert figures is not None
    assert figures.place_um is not None
    assert figures.force_mN is not None
    assert figures.place_um.rmse < 0.01 * 8.0
    assert figures.force_mN.rmse < 0.02 * 10.0


def test_a_limit_that_either_arm_would_break_is_reported_with_value_and_limit() -> None:
    plan = predicted({"kind": "grip", "place_um": 35.0, "hold_s": 0.5})
    assert not plan.feasible
    broken = prediction_of(plan).violations
    assert broken
    assert all(each.pointer == "/place_um" for each in broken)
    assert any(
        each.message.startswith("arm 1: predicted: position") and "the limit 60 µm" in each.message
        for each in broken
    ), [each.message for each in broken]
