"""Calibration requests: which are valid, which are refused, and the prediction of a dry run."""

from typing import Any

import pytest
from pydantic import TypeAdapter

from pincette.config import RigFile, read_rig
from pincette.control.planning.program import Guards
from pincette.control.planning.segments import Seek
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.rigs import DEMO, demo_rig

from .harness import Harness

REQUEST: TypeAdapter[Any] = TypeAdapter(Body)


def body(calibration: str, **wishes: Any) -> dict[str, Any]:
    return {"kind": "calibrate", "calibration": calibration, **wishes}


@pytest.mark.parametrize(
    ("request_", "pointer", "words"),
    [
        ({"kind": "calibrate"}, "/calibration", "calibration is missing"),
        (body("colour"), "/calibration", "calibration = 'colour'"),
        (body("noise", weights_mN=[0.0]), "/weights_mN", "weights_mN is not a known field"),
        (body("noise", duration_s=0.1), "/duration_s", "must be 2 s or more"),
        (body("compliance", weights_mN=[0.0, -5.0]), "/weights_mN/1", "weights_mN[1] = -5.0 mN: "),
        (body("free_response", low_V=1.0, high_V=0.5), "", "low_V = 1.0 V is not below high_V"),
        (body("frequency_response", from_hz=900.0), "", "from_hz = 900.0 Hz is not below to_hz"),
        (body("contact_stiffness", levels_V=[0.3, 1.0]), "/levels_V", "3 or more"),
    ],
)
def test_a_fault_is_reported_with_its_location(
    harness: Harness, request_: dict[str, Any], pointer: str, words: str
) -> None:
    problem = harness.post("/jobs", request_).json()
    assert problem["type"] == "urn:pincette:problem:invalid-request"
    (error,) = problem["errors"]
    assert error["pointer"] == pointer
    assert words in error["message"]


def test_jobs_and_calibrations_accept_the_same_calibration_request(harness: Harness) -> None:
    as_job = harness.post("/jobs", body("noise", duration_s=4.0), dry_run="true")
    alone = harness.post(
        "/calibrations", {"calibration": "noise", "duration_s": 4.0, "dry_run": True}
    )
    assert as_job.status_code == alone.status_code == 200
    assert as_job.json() == alone.json()
    assert as_job.json()["duration_s"] == 4.0
    (error,) = harness.post("/calibrations", {"calibration": "noise", "hold_s": 1.0}).json()[
        "errors"
    ]
    assert error["pointer"] == "/hold_s"


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (body("compliance", weights_mN=[0.0, 90.0]), "weight = 90.000 mN, limits 0 mN to 40 mN"),
        (body("compliance", weights_mN=[5.0, 10.0]), "must be 0 mN and at least one more"),
        (body("free_response", high_V=4.5), "= 4.500 V, limits -1 V to 4 V"),
        (body("contact_stiffness", levels_V=[0.3, 1.0, 2.5]), "above the limit"),
    ],
)
def test_a_motion_beyond_a_limit_is_refused_before_it_begins(
    harness: Harness, request_: dict[str, Any], words: str
) -> None:
    response = harness.post("/jobs", request_)
    assert response.status_code == 422
    assert words in response.json()["detail"]
    assert harness.get("/jobs")["jobs"] == []


def test_a_weighing_requests_weights_first_in_increasing_and_then_in_decreasing_order(
    harness: Harness,
) -> None:
    plan = harness.post(
        "/jobs", body("compliance", weights_mN=[0.0, 5.0, 10.0]), dry_run="1"
    ).json()
    assert plan["feasible"] is True
    assert plan["waits"] == 5
    waiting = [phase for phase in plan["phases"] if phase["duration_s"] is None]
    assert [phase["instruction"].split(",")[0] for phase in waiting] == [
        "take every weight off the tip",
        "hang 5 mN on the tip",
        "hang 10 mN on the tip",
        "hang 5 mN on the tip",
        "take every weight off the tip",
    ]
    assert plan["law"] is None


def test_a_plan_predicts_its_voltages_within_the_limits(harness: Harness) -> None:
    free = harness.post("/jobs", body("free_response", high_V=2.5), dry_run="true").json()
    assert (free["voltage_min_V"], free["voltage_max_V"]) == pytest.approx((-1.0, 2.5), abs=1e-9)
    press = harness.post("/jobs", body("contact_stiffness"), dry_run="true").json()
    assert 2.0 < press["voltage_max_V"] < 4.0
    assert press["law"]["gains_from"] == "rig"
    assert [(item["quantity"], item["source"]) for item in press["assumptions"]] == [
        ("model.compliance_um_per_mN", "assumed"),
        ("model.free_response", "assumed"),
    ]


def test_slow_instruments_are_reported_with_their_bandwidth(harness: Harness) -> None:
    response = harness.post("/jobs", body("frequency_response", to_hz=700.0))
    assert response.status_code == 422
    problem = response.json()
    assert problem["type"] == "urn:pincette:problem:calibration-unsupported"
    assert problem["needed_hz"] == 700.0
    assert 0.0 <= problem["bandwidth_hz"] < 700.0
    assert [part["part"] for part in problem["parts"]] == ["sensor", "output"]
    for words in ("no buffered acquisition", "damping_ratio = 0.026", "assumed"):
        assert words in problem["detail"]


def test_a_period_that_does_not_show_the_mode_is_reported_with_the_remedy(harness: Harness) -> None:
    response = harness.post("/jobs", body("output_timing"))
    assert response.status_code == 422
    problem = response.json()
    assert problem["type"] == "urn:pincette:problem:calibration-unsupported"
    assert problem["bandwidth_hz"] < problem["needed_hz"] == pytest.approx(388.0, abs=1.0)
    assert "Choose a shorter period" in problem["detail"]


def test_the_hysteresis_of_an_unknown_arm_is_not_mistaken_for_too_much_force() -> None:
    """An arm of a 39 % loop, begun at its remanence, read 46 mN of a straight line and was ended.

    Where a free response is identified, the limit is that of the rig.
    """

    def most_mN(rig: RigFile) -> float:
        request = REQUEST.validate_python(body("free_response"))
        return plan_job(request, rig).program.guards.force_max_mN

    unknown, known = read_rig(DEMO.with_name("bring-up.toml")), demo_rig()
    assert known.model.free_response is not None
    assert most_mN(known) == known.limits.force_max_mN
    # Half of the 19 µm/V over more than 3 V, by 0.46 µm/mN.
    assert most_mN(unknown) > unknown.limits.force_max_mN + 60.0


def test_if_a_person_has_confirmed_that_there_is_no_part_an_arm_that_bends_is_accepted() -> None:
    """A free arm of wide relays read 3 mN of its own bend and could not be brought up.

    Without that confirmation every kink above the contact force is a touch; with it, one that is
    softer than the softest part admitted is a bend of the arm.
    """

    def guards(**more: bool) -> Guards:
        request = REQUEST.validate_python({**body("free_response"), **more})
        return plan_job(request, rig).program.guards

    rig = read_rig(DEMO.with_name("bring-up.toml"))
    contact_mN, part = rig.grip.contact_force_mN, rig.part
    softest = part.stiffness_mN_per_um * (1.0 - part.stiffness_tolerance)
    assert (guards().contact_force_mN, guards().bend_mN_per_um) == (contact_mN, 0.0)
    confirmed = guards(no_part=True)
    assert confirmed.contact_force_mN == contact_mN
    assert 0.5 * softest < confirmed.bend_mN_per_um < softest


def test_the_search_range_for_a_part_includes_the_possible_drift_of_the_sensor() -> None:
    """A drift of 0.74 µm/min carried the reading beyond the tolerance: no part was met."""

    def furthest_um(drift_um_per_min: float) -> float:
        rig = demo_rig({"sensor": {"drift_um_per_min": drift_um_per_min}})
        program = plan_job(REQUEST.validate_python(body("contact_stiffness")), rig).program
        (seek,) = [segment for segment in program.segments if isinstance(segment, Seek)]
        (to_um,) = seek.to_um
        assert to_um is not None
        return to_um

    assert furthest_um(0.7) == pytest.approx(furthest_um(0.0) + 7.0)
