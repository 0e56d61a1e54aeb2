from itertools import pairwise

import pytest

from pincette.api.plans import Plan
from pincette.config.derived import conditioning_V, planned_rig
from pincette.control.planning.conditioning import REST_S, STROKES, conditioning, stroke_depth_V
from pincette.control.planning.segments import paths_of
from pincette.control.response.hysteresis import displacement_um, step
from pincette.control.response.poled import poled
from pincette_supervisor.kinds.characterise import CharacteriseJobRequest
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import FaultyRequestError, Present
from pincette_supervisor.plugin.stated_uncertainty import past_uncertainty_mN
from tests.support.rigs import Tree, demo_rig

TAUGHT: Tree = {"model": {"free_response": {"taught_V": [-0.8, 3.4]}}}
SLEW_V_PER_S = 10.0


@pytest.mark.parametrize(
    ("taught_V", "voltage_min_V", "depth_V"),
    [
        (None, -1.0, None),
        ((-0.8, 3.0), -1.0, -0.8),
        ((-0.8, 3.0), -0.5, -0.5),
        ((0.0, 3.0), -1.0, None),
        ((-0.8, 3.0), 0.0, None),
        ((-0.1, 3.0), -1.0, None),
    ],
)
def test_strokes_go_no_lower_than_the_identified_range_and_the_voltage_limit(
    taught_V: tuple[float, float] | None, voltage_min_V: float, depth_V: float | None
) -> None:
    assert stroke_depth_V(taught_V, voltage_min_V) == depth_V


def test_three_strokes_stay_below_the_slew_limit_and_end_with_a_rest_at_0_V() -> None:
    *_, strokes = conditioning(-0.8, SLEW_V_PER_S, 0.0, 19.0)
    (path,), period_s = paths_of(strokes), 0.001
    voltages_V = [path.at(tick * period_s) for tick in range(round(path.duration_s / period_s) + 1)]
    rates = [abs(after - before) / period_s for before, after in pairwise(voltages_V)]
    assert max(rates) <= SLEW_V_PER_S
    assert min(voltages_V) == -0.8
    assert max(voltages_V) == voltages_V[-1] == 0.0
    values_V = [knot.value for knot in path.knots]
    assert sum(before != after == -0.8 for before, after in pairwise(values_V)) == STROKES
    assert strokes.duration_s == pytest.approx(path.duration_s + REST_S)


@pytest.mark.parametrize(
    ("condition", "known", "conditioned"),
    [
        ("auto", False, True),
        ("auto", True, True),
        ("auto", None, True),
        (None, False, True),
        ("always", True, True),
        ("never", False, False),
    ],
)
def test_a_plan_starts_with_strokes_if_they_are_required(
    condition: str | None, known: bool | None, *, conditioned: bool
) -> None:
    rig = demo_rig(TAUGHT)
    present = Present(x_um=0.0, memory_known=known)
    request = GripJobRequest.model_validate({"kind": "grip", "condition": condition})
    plan = plan_job(request, rig, present).plan
    usual = plan_job(GripJobRequest(kind="grip", condition="never"), rig, present).plan
    assert plan.violations == []
    assert (plan.phases[0].phase == "condition") is conditioned
    longer_s = plan.duration_s - usual.duration_s
    assert (longer_s > REST_S) if conditioned else longer_s == 0.0
    assert plan.phases[-1].voltage_V == pytest.approx(usual.phases[-1].voltage_V, abs=1e-12)


def test_strokes_between_two_grips_keep_their_voltages_and_are_remembered() -> None:
    """Voltages below those of the strokes were planned, which the free response does not know."""
    body = {"kind": "characterise", "condition": "always", "noise_s": 4.0, "grips": 2}
    request = CharacteriseJobRequest.model_validate(body)
    plan = plan_job(request, demo_rig(TAUGHT), Present(x_um=0.0)).plan
    assert isinstance(plan, Plan)
    assert plan.violations == []
    strokes = [phase for phase in plan.phases if phase.phase == "condition"]
    assert strokes[-1].voltage_V == 0.0
    loads_V = [phase.voltage_V for phase in plan.phases if phase.phase == "load"]
    assert loads_V[1] == pytest.approx(loads_V[0], rel=0.01)


def test_the_refusal_of_strokes_that_the_model_does_not_allow_points_to_the_field_condition() -> (
    None
):
    with pytest.raises(FaultyRequestError) as refused:
        plan_job(GripJobRequest(kind="grip", condition="always"), demo_rig())
    assert refused.value.pointer == "/condition"


def test_a_plan_without_strokes_warns_of_an_unknown_past() -> None:
    known, unknown = [
        plan_job(GripJobRequest(kind="grip"), demo_rig(), Present(memory_known=memory)).plan
        for memory in (True, False)
    ]
    assert isinstance(known, Plan)
    assert isinstance(unknown, Plan)
    assert len(unknown.warnings) == len(known.warnings) + 1


def test_a_plan_without_strokes_states_the_uncertainty_from_an_unknown_past() -> None:
    """U of such grips reached 22 mN, whereas the plan assumed some mN, and the load was
    abandoned."""
    # On a stiff arm the same error of the free response is a larger force.
    rig = demo_rig({"model": {**TAUGHT["model"], "compliance_um_per_mN": 0.06}})

    def planned(force_mN: float, known: bool, condition: str) -> Plan:
        body = {"kind": "grip", "force_mN": force_mN, "condition": condition}
        request = GripJobRequest.model_validate(body)
        plan = plan_job(request, rig, Present(x_um=0.0, memory_known=known)).plan
        assert isinstance(plan, Plan)
        return plan

    stated_mN = past_uncertainty_mN(rig, 15.0)
    print(stated_mN)
    (refused,) = [
        found for found in planned(15.0, False, "never").violations if "past" in found.message
    ]
    assert (refused.pointer, refused.quantity) == ("/force_mN", "force")
    assert refused.limit == stated_mN > 15.0
    for known, condition in ((True, "never"), (False, "auto")):
        found = planned(15.0, known, condition).violations
        assert not any("past" in one.message for one in found)
    assert any(f"±{stated_mN:.2g} mN" in one for one in planned(15.0, False, "never").warnings)


def test_a_plan_for_a_rig_without_negative_voltages_has_no_strokes_and_a_warning() -> None:
    """The force of that rig has the uncertainty of an unknown history, but no force is refused for
    it."""
    rig = demo_rig({**TAUGHT, "limits": {"voltage_min_V": 0.0}})
    assert conditioning_V(rig) is None
    present = Present(x_um=0.0, memory_known=False)
    plan = plan_job(GripJobRequest(kind="grip"), rig, present).plan
    assert isinstance(plan, Plan)
    assert plan.violations == []
    assert plan.phases[0].phase == "zero"
    past_mN = past_uncertainty_mN(rig, 20.0)
    (selected,) = [warning for warning in plan.warnings if "the arm's past is not known" in warning]
    assert "voltage_min_V = 0 V leaves no room for conditioning strokes" in selected
    assert f"±{past_mN:.2g} mN" in selected
    assert past_mN > 0.0
    for share in (0.5, 2.0):
        goal = GripJobRequest(kind="grip", force_tolerance_mN=share * past_mN)
        plan = plan_job(goal, rig, present).plan
        assert isinstance(plan, Plan)
        assert plan.goal is not None
        assert plan.goal.judged is (share > 1.0)
        assert plan.goal.judged is not any("will not be judged" in one for one in plan.warnings)
    with pytest.raises(FaultyRequestError, match=r"limits\.voltage_min_V = 0 V leaves no room"):
        plan_job(GripJobRequest(kind="grip", condition="always"), rig, present)


def test_a_rig_file_may_omit_strokes() -> None:
    rig = demo_rig({**TAUGHT, "grip": {"condition": "never"}})
    plan = plan_job(GripJobRequest(kind="grip"), rig, Present(memory_known=False)).plan
    assert plan.phases[0].phase == "zero"


def test_strokes_bring_arms_with_different_histories_to_the_same_position() -> None:
    rig = demo_rig(TAUGHT)
    model, low_V = planned_rig(rig).free_response, -0.8
    assert model is not None
    assert conditioning_V(rig) == low_V
    memory = poled(model, (low_V, 3.4))
    assert planned_rig(rig).memory == memory
    at_um: dict[float, tuple[float, float]] = {}
    for past_V in (1.0, 2.0, 3.4):
        state = step(model, step(model, memory, past_V, 60.0), 0.0, 30.0)
        before_um = displacement_um(model, state)
        for to_V in (low_V, 0.0) * STROKES:
            state = step(model, state, to_V, 0.2)
        state = step(model, state, 0.0, REST_S)
        at_um[past_V] = before_um, displacement_um(model, state)
    before, after = zip(*at_um.values(), strict=True)
    assert max(before) - min(before) > 1.0
    assert max(after) - min(after) < 0.15 * (max(before) - min(before))
