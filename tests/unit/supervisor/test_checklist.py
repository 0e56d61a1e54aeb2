"""The checklist of calibrations: order, the next step and its reason, and the gained accuracy."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from pincette.config import RigFile, read_rig
from pincette_supervisor.jobs import bring_up
from pincette_supervisor.jobs.bring_up import Step, ordered
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.kinds.calibrate import KIND
from pincette_supervisor.kinds.calibrate.compliance import weights_within
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.rigs import DEMO, Tree, demo_rig

from .harness import Harness
from .test_calibrations import decide, proposal

COMPLIANCE = "model.compliance_um_per_mN"


def steps(harness: Harness) -> dict[str, dict[str, Any]]:
    found = harness.get("/rigs/demo/checklist")
    return {step["calibration"]: step for step in found["steps"]}


def codes(step: dict[str, Any]) -> list[str]:
    return [reason["code"] for reason in step["reasons"]]


def test_assumed_values_are_identified_before_they_are_needed() -> None:
    found: set[str] = set()
    for step in ordered():
        assert not set(step.functions.assumes) - found
        found |= set(step.functions.finds)
    listed = [name for name in KIND.variants if name not in ("residual", "gain_check")]
    assert [step.variant.name for step in ordered()] == listed


def test_the_order_of_checklist_steps_follows_their_requirements(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    named = bring_up.functions_of

    def turned(name: str) -> Any:
        needs_press = name == "noise"
        return replace(
            named(name), assumes=("part.contact_um",) if needs_press else named(name).assumes
        )

    monkeypatch.setattr(bring_up, "functions_of", turned)
    names = [step.variant.name for step in ordered.__wrapped__()]
    assert names[0] == "compliance"
    assert names[-2:] == ["contact_stiffness", "noise"]


def test_an_uncalibrated_rig_starts_with_the_noise(harness: Harness) -> None:
    found = harness.get("/rigs/demo/checklist")
    assert found["next"] == "noise"
    states = {step["calibration"]: step["state"] for step in found["steps"]}
    assert states == {
        "noise": "next",
        "compliance": "later",
        "free_response": "later",
        "frequency_response": "unsupported",  # its instruments have no buffers
        "output_timing": "unsupported",  # its period does not resolve the mode either
        "contact_stiffness": "later",
    }
    by_name = steps(harness)
    assert [need["code"] for need in by_name["compliance"]["needs"]] == ["part_removed", "weights"]
    assert codes(by_name["frequency_response"]) == ["not_calibrated", "unsupported"]
    assert "no buffered acquisition" in by_name["frequency_response"]["reasons"][1]["text"]
    assert codes(by_name["output_timing"]) == ["not_calibrated", "unsupported"]


def test_each_step_of_the_checklist_is_planned_once_for_each_model(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned: list[str] = []

    def counted(step: Step) -> Step:
        def program(request: Any, *of: Any) -> Any:
            planned.append(step.variant.name)
            return step.functions.program(request, *of)

        return replace(step, functions=replace(step.functions, program=program))

    found = tuple(counted(step) for step in ordered())
    monkeypatch.setattr(bring_up, "ordered", lambda: found)
    name = proposal(harness)
    planned.clear()
    before = [harness.get("/rigs/demo/checklist") for _ in range(3)]
    assert before[0] == before[1] == before[2]
    assert sorted(planned) == sorted(step.variant.name for step in found)
    planned.clear()
    decide(harness, name, "accept")
    after = [harness.get("/rigs/demo/checklist") for _ in range(3)]
    assert after[0] == after[1] == after[2]
    # The noise is done, and a completed calibration is not planned.
    assert sorted([*planned, "noise"]) == sorted(step.variant.name for step in found)


def test_decisions_of_many_proposals_are_read_in_one_query(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [proposal(harness), proposal(harness)]
    decide(harness, names[0], "discard")
    read: list[int] = []
    get_notes = harness.store.get_notes

    def counted(wanted: Sequence[str]) -> dict[str, str]:
        read.append(len(wanted))
        return get_notes(wanted)

    monkeypatch.setattr(harness.store, "get_notes", counted)
    states = [one["state"] for one in harness.get("/calibrations")["calibrations"]]
    assert states == ["proposed", "discarded"]
    assert read == [2]


def test_at_1_khz_bursts_replace_the_sweep() -> None:
    rig = read_rig(DEMO.parent / "kilohertz.toml")
    needed = {step.variant.name: step.functions.needed(rig) for step in ordered()}
    assert (needed["frequency_response"], needed["output_timing"]) == (False, True)


def test_the_request_of_each_checklist_step_is_accepted(harness: Harness) -> None:
    for step in steps(harness).values():
        if step["state"] != "unsupported":
            answer = harness.post("/jobs", step["request"], dry_run="true")
            assert (answer.status_code, answer.json()["feasible"]) == (200, True)


def test_the_calibration_of_the_model_in_use_is_found_behind_any_number_of_proposals(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = proposal(harness)
    decide(harness, name, "accept")
    monkeypatch.setattr(bring_up, "LOOKED_AT", 0)
    noise = steps(harness)["noise"]
    assert (noise["state"], noise["accepted"]) == ("done", name)


def test_the_next_checklist_step_follows_once_a_proposal_is_accepted(harness: Harness) -> None:
    name = proposal(harness)
    noise = steps(harness)["noise"]
    assert (noise["state"], noise["proposal"], noise["gained"]) == ("next", name, [])
    assert codes(noise) == ["proposed", "not_calibrated"]
    decide(harness, name, "accept")
    found = harness.get("/rigs/demo/checklist")
    assert found["next"] == "compliance"
    noise = found["steps"][0]
    assert (noise["state"], noise["accepted"], noise["reasons"]) == ("done", name, [])
    gained, drift = noise["gained"]
    assert drift["quantity"] == "sensor.drift_um_per_min"
    assert gained["quantity"] == "sensor.noise_um"
    assert (gained["in_use"], gained["source_in_use"]) == (0.03, "assumed")
    assert noise["statement"]
    assert noise["accepted_at"]
    harness.post("/rigs/demo/model/actions", {"type": "use", "version": 0})
    assert harness.get("/rigs/demo/checklist")["next"] == "noise"


def test_a_discarded_step_must_be_repeated(harness: Harness) -> None:
    decide(harness, proposal(harness), "discard")
    noise = steps(harness)["noise"]
    assert (noise["state"], noise["proposal"]) == ("next", None)


def test_a_checklist_step_that_assumed_another_value_must_be_repeated(harness: Harness) -> None:
    """The press rests on the compliance, which is measured afterwards here."""
    name = proposal(harness)
    row = harness.store.get(name)
    assert row is not None
    assert row.result is not None
    row.result["calibration"] = "contact_stiffness"
    row.result["values"][0] |= {"quantity": "part.contact_um", "value": 31.0, "unit": "µm"}
    row.result["assumptions"] = [
        {"quantity": COMPLIANCE, "value": 0.46, "unit": "µm/mN", "source": "assumed"}
    ]
    harness.store.change(name, result=row.result)
    decide(harness, name, "accept")
    assert steps(harness)["contact_stiffness"]["state"] == "done"
    harness.manager.context.model.add({COMPLIANCE: 0.44}, {}, "another")
    press = steps(harness)["contact_stiffness"]
    assert press["state"] == "later"
    assert codes(press) == ["assumption_changed"]
    assert COMPLIANCE in press["reasons"][0]["text"]


def test_an_overdue_calibration_is_the_next_step_again(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    days = rig_file.calibration.model_copy(update={"valid_days": 1e-9})
    harness = open_harness(rig_file.model_copy(update={"calibration": days}))
    decide(harness, proposal(harness), "accept")
    noise = steps(harness)["noise"]
    assert (noise["state"], codes(noise)) == ("next", ["overdue"])
    assert noise["gained"]


def test_a_calibration_that_would_be_refused_is_marked(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    tight = rig_file.limits.model_copy(update={"position_max_um": 25.0})
    harness = open_harness(rig_file.model_copy(update={"limits": tight}))
    press = steps(harness)["contact_stiffness"]
    assert codes(press) == ["not_calibrated", "refused"]


def test_a_sweep_is_needed_if_the_estimator_uses_the_mode() -> None:
    (sweep,) = [step for step in ordered() if step.variant.name == "frequency_response"]
    fast = read_rig(DEMO.parent / "fast.toml")
    assert sweep.functions.needed(fast) == (fast.model.force_observer != "quasi_static")
    assert not sweep.functions.needed(read_rig(DEMO))


@pytest.mark.parametrize(
    ("changes", "weights_mN"),
    [
        ({}, [0.0, 5.0, 10.0, 20.0]),
        ({"limits": {"force_max_mN": 12.0}, "grip": {"force_mN": 8.0}}, [0.0, 1.25, 2.5, 5.0]),
        ({"model": {"compliance_um_per_mN": 4.6}}, [0.0, 0.5, 1.0, 2.0]),
    ],
)
def test_default_weights_are_within_the_limits(changes: Tree, weights_mN: list[float]) -> None:
    rig = demo_rig(changes)
    assert weights_within(rig) == pytest.approx(weights_mN)
    request = REQUEST.validate_python({"kind": "calibrate", "calibration": "compliance"})
    planned = plan_job(request, rig)
    assert planned.values["weights_mN"] == pytest.approx(weights_mN)
