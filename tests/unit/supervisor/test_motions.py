"""Moves, holds and releases from their request to a plan, a result and a picture."""

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from pincette.api.job_kinds import job_kinds
from pincette.api.plans import MotionPlan
from pincette.api.requests import JobRequest
from pincette.api.results import MotionResult
from pincette.config import RigFile
from pincette.core.faults import Cause, Mode, Outcome
from pincette.core.messages import Applied, Estimate, Message, Position, Telemetry
from pincette.core.messages.arms import ArmApplied, ArmEstimate, ArmPosition, ArmTelemetry
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import FaultyRequestError, Planned, Present, functions_of
from pincette_supervisor.plugin.drawing import Picture
from pincette_supervisor.results.archive import Take, gather
from tests.support.rigs import demo_rig

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
RIG = demo_rig()
HELD = Present(voltage_V=2.5, x_um=39.0, held=True)
FREE = Present(voltage_V=0.5, x_um=9.0, held=False)


def plan(
    body: dict[str, Any], present: Present | None = FREE, rig: RigFile = RIG
) -> tuple[Planned, MotionPlan]:
    planned = plan_job(REQUEST.validate_python(body), rig, present)
    assert isinstance(planned.plan, MotionPlan)
    return planned, planned.plan


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        ({}, "found none"),
        ({"to_um": 3.0, "by_V": 0.1}, "found to_um and by_V"),
        ({"to_V": 1.0, "low_V": 0.0}, "low_V applies to cycles only"),
        ({"to_V": 1.0, "conditioning_cycles": 1, "low_V": 2.0, "high_V": 1.0}, "not below"),
        ({"to_V": 1.0, "conditioning_cycles": 21}, "less than or equal to 20"),
        ({"to_um": 1.0, "teach": "my pose"}, "string_pattern|should match pattern"),
        ({"to_um": "3"}, "valid number"),
        ({"to_um": 3.0, "force_mN": 2.0}, "Extra inputs"),
        ({"to_um": 3.0, "on_stop": "hold"}, "Extra inputs"),
    ],
)
def test_an_inconsistent_move_is_refused(wish: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        REQUEST.validate_python({"kind": "move", **wish})


def test_a_hold_ends_either_after_a_time_or_by_a_release_and_not_both() -> None:
    with pytest.raises(ValidationError, match="exclude each other"):
        REQUEST.validate_python({"kind": "hold", "hold_s": 2.0, "until_released": True})


@pytest.mark.parametrize("kind", ["grip", "track", "hold"])
def test_a_holding_job_states_what_happens_to_its_part(kind: str) -> None:
    plain = REQUEST.validate_python({"kind": kind})
    assert getattr(plain, "on_stop", None) == "hold"
    assert getattr(plain, "on_abort", None) == "freeze"
    request = REQUEST.validate_python({"kind": kind, "on_stop": "retract", "on_abort": "ramp"})
    assert getattr(request, "on_stop", None) == "retract"
    with pytest.raises(ValidationError, match="'hold', 'release' or 'retract'"):
        REQUEST.validate_python({"kind": kind, "on_stop": "drop"})


@pytest.mark.parametrize("name", ["bead 1", "@2", "bead@0", "bead@", ""])
def test_a_recipe_is_a_name_with_or_without_a_version(name: str) -> None:
    with pytest.raises(ValidationError, match="should match pattern"):
        REQUEST.validate_python({"kind": "grip", "recipe": name})
    REQUEST.validate_python({"kind": "grip", "recipe": "bead-1mm@3", "queue": True})


def test_a_move_starts_at_the_present_position() -> None:
    planned, view = plan({"kind": "move", "by_um": 3.0})
    assert view.feasible
    assert view.begins_at.model_dump() == {"x_um": 9.0, "voltage_V": 0.5}
    assert planned.values["to_um"] == 12.0
    assert (view.curves.x_r_um[0], view.curves.voltage_V[0]) == (9.0, 0.5)
    assert view.curves.x_r_um[-1] == pytest.approx(12.0)
    assert view.law is not None
    assert planned.program.laws
    assert (planned.begins_held, planned.present) == (False, FREE)


def test_an_unreported_rig_is_assumed_at_rest_with_a_warning() -> None:
    _, view = plan({"kind": "move", "by_um": 3.0}, None)
    assert view.begins_at.x_um is None
    assert view.curves.x_r_um[0] == 0.0
    assert "the arm has not reported its position yet" in view.warnings[0]
    assert "give a target position instead of a distance" in view.warnings[1]


def test_a_move_to_a_voltage_needs_no_law() -> None:
    planned, view = plan({"kind": "move", "to_V": 1.0})
    assert view.law is None
    assert planned.program.laws


def test_conditioning_cycles_do_not_touch_the_part_by_default() -> None:
    body = {"kind": "move", "to_um": 5.0, "conditioning_cycles": 2}
    _, view = plan(body)
    assert max(view.curves.x_r_um) < RIG.part.contact_um - RIG.part.contact_tolerance_um
    assert not any("may touch" in text for text in view.warnings)
    _, far = plan({**body, "high_V": 2.5})
    assert any("may touch the part" in text for text in far.warnings)
    with pytest.raises(FaultyRequestError, match="must be below") as fault:
        plan({**body, "low_V": 3.0})
    assert fault.value.pointer == "/low_V"


@pytest.mark.parametrize(
    ("wish", "pointer", "quantity"),
    [
        ({"to_um": 90.0}, "/to_um", "position"),
        ({"by_um": -40.0}, "/by_um", "position"),
        ({"to_V": 4.2}, "/to_V", "voltage"),
        ({"by_V": -1.7}, "/by_V", "voltage"),
        ({"to_V": 3.0, "speed_um_per_s": 900.0}, "/speed_um_per_s", "slew"),
        ({"to_V": 1.0, "conditioning_cycles": 1, "high_V": 4.4}, "/high_V", "voltage"),
        (
            {"to_V": 1.0, "warm_up_s": 9.0, "rate_V_per_s": 20.0},
            "/rate_V_per_s",
            "slew",
        ),
    ],
)
def test_a_limit_that_a_move_breaks_is_named(
    wish: dict[str, Any], pointer: str, quantity: str
) -> None:
    _, view = plan({"kind": "move", **wish})
    assert not view.feasible
    found = {(violation.pointer, violation.quantity) for violation in view.violations}
    assert (pointer, quantity) in found


@pytest.mark.parametrize("kind", ["hold", "release"])
def test_a_held_part_is_released_within_the_slew_limit(kind: str) -> None:
    planned, view = plan({"kind": kind}, HELD)
    assert planned.begins_held
    assert (view.feasible, view.warnings, view.law) == (True, [], None)
    assert planned.values["release_s"] == RIG.grip.load_s
    assert view.curves.voltage_V[0] == 2.5
    assert view.curves.voltage_V[-1] == pytest.approx(0.0)
    _, quick = plan({"kind": kind, "release_s": 0.2}, HELD)
    assert [violation.pointer for violation in quick.violations] == ["/release_s"]
    assert (planned.planned_s is None) == (kind == "hold")


def test_an_operator_may_state_that_a_part_is_held() -> None:
    for present, words in ((FREE, "is not known to the rig"), (Present(2.5, 39.0), "is not known")):
        _, view = plan({"kind": "hold", "hold_s": 3.0}, present)
        assert view.feasible
        assert words in view.warnings[-1]
    _, moved = plan({"kind": "move", "to_um": 3.0}, HELD)
    assert any("a move releases it" in text for text in moved.warnings)


def samples(count: int, *, held: bool) -> list[Message]:
    """Return a rest at 12 µm and 0.6 V after a ramp to there."""
    made: list[Message] = []
    for seq in range(count):
        x_um = min(12.0, 0.24 * seq)
        tip = ArmEstimate(x_um, 0.1, 0.2, 0.0, None, None, 0.6, 0)
        output, final = ArmApplied(0.05 * x_um, 0), seq == count - 1
        made += [
            Position(1, seq, 0.02 * seq, (ArmPosition(x_um, valid=True),)),
            Estimate(1, seq, seq - 1, False, False, (tip,), True),
            Telemetry(
                1, seq, True, "hold" if held else "move", 0, seq, (ArmTelemetry(x_um, x_um),),
                0.0, 0.0, 1.0, 0.0, 0.0, 0.0, Outcome.MOVED, None, None, held, (),
            ),
            Applied(
                1, seq, (output,), Mode.ARMED, Cause.NONE, held, False, final, True, 0, 0.0
            ),
        ]  # fmt: skip
    return made


@pytest.mark.parametrize("held", [False, True])
def test_the_result_states_the_pose_and_what_is_held(held: bool) -> None:
    body = {"kind": "hold"} if held else {"kind": "move", "to_um": 12.5, "teach": "ready"}
    planned, _ = plan(body, HELD if held else FREE)
    row = JobRow("job", planned.plan.kind, "demo", "running", body, {}, "")
    record = gather(RIG, row, planned, Take(1, samples(100, held=held)))
    result = record.result
    assert isinstance(result, MotionResult)
    assert (result.ends_at.x_um, result.ends_at.voltage_V) == pytest.approx((12.0, 0.6))
    assert (result.begins_at.x_um, result.held_at_end) == (0.0, held)
    if held:
        assert (result.teach, result.target_um, result.target_error_um) == (None, None, None)
        assert result.drift_um == pytest.approx(12.0)
    else:
        assert (result.teach, result.target_um) == ("ready", 12.5)
        assert result.target_error_um == pytest.approx(-0.5)
        assert result.drift_um is None
    # A force that was never zeroed has no reference.
    assert (result.final_force_mN, result.force_uncertainty_mN) == (None, None)
    plot = functions_of(job_kinds()[row.kind]).plot
    drawn = plot(record.run, record.evaluation, "demo · job")
    assert isinstance(drawn, Picture)
    assert drawn.png.startswith(b"\x89PNG")
